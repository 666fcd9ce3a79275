"""Makes portraits of the first virtual patients: half face, half skull."""

from collections.abc import Sequence

from pinnochio.importing.segmentation import read_segmentation
from pinnochio.json_text import read_stored_json
from pinnochio.logs import attach_log
from pinnochio.virtual.portraits import Sitter, gallery

COLUMNS, PANEL = 4, (420, 460)
LARGE_PANEL = (760, 800)
NAMES = {"class_ii": "Class II", "class_iii": "Class III", "asymmetry": "asymmetry", "open_bite": "open bite"}


def render_cohort(
    cases: Sequence[str],
    segmentations: Sequence[str],
    anatomies: Sequence[str],
    label_values: dict[str, int],
    segments: tuple[str, ...],
    cohort: str,
    heads: str,
) -> None:
    """Draw all cases in one picture (PNG), and the first two large in another."""
    sitters = []
    for case, segmentation, anatomy in zip(cases, segmentations, anatomies, strict=True):
        about = read_stored_json(anatomy)
        caption = f"{case}: {about['sex']}, {NAMES[about['deformity']]}"
        head = read_segmentation(path=segmentation, case=case, label_values=label_values, segments=segments)
        sitters.append(Sitter(caption, head, head.segments))
    gallery(sitters=sitters, columns=COLUMNS, panel=PANEL, path=cohort)
    gallery(sitters=sitters[:2], columns=2, panel=LARGE_PANEL, path=heads)


if __name__ == "__main__":
    attach_log(snakemake.log[0])
    render_cohort(
        cases=snakemake.params.cases,
        segmentations=snakemake.input.segmentations,
        anatomies=snakemake.input.anatomies,
        label_values=snakemake.params.labels,
        segments=tuple(snakemake.params.segments),
        cohort=snakemake.output.cohort,
        heads=snakemake.output.heads,
    )
