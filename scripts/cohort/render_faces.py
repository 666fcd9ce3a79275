"""Makes the contact sheet of the first virtual patients: face, skull and outcome of each."""

from collections.abc import Sequence

from pinnochio.importing.segmentation import read_segmentation
from pinnochio.json_text import read_stored_json
from pinnochio.logs import attach_log
from pinnochio.model.truth import read_truth
from pinnochio.virtual.portraits import Sitter, contact_sheet


def render_faces(
    cases: Sequence[str],
    segmentations: Sequence[str],
    anatomies: Sequence[str],
    truths: Sequence[str],
    label_values: dict[str, int],
    segments: tuple[str, ...],
    sheet: str,
) -> None:
    """Draw all cases in one picture (PNG), two to a row."""
    sitters, fields = [], []
    for case, segmentation, anatomy, truth in zip(cases, segmentations, anatomies, truths, strict=True):
        about = read_stored_json(anatomy)
        head = read_segmentation(path=segmentation, case=case, label_values=label_values, segments=segments)
        sitters.append(Sitter(f"{case} {about['sex']} {about['deformity'].replace('_', ' ')}", head, head.segments))
        fields.append(read_truth(truth, case)[:3])
    contact_sheet(sitters=sitters, fields=fields, path=sheet)


if __name__ == "__main__":
    attach_log(snakemake.log[0])
    render_faces(
        cases=snakemake.params.cases,
        **dict(snakemake.input.items()),
        label_values=snakemake.params.labels,
        segments=tuple(snakemake.params.segments),
        sheet=snakemake.output.sheet,
    )
