"""Makes the bones of a virtual patient as a segmented scan after surgery shows them, in the scanner's own frame."""

from collections.abc import Sequence

from pinnochio.importing.segmentation import read_segmentation, write_segmentation
from pinnochio.plans.plan import Plan
from pinnochio.seeds import generator
from pinnochio.virtual.bone_scan import scan_bones


def virtual_postop_bones(
    case: str,
    segmentation: str,
    executed: str,
    label_values: dict[str, int],
    segments: Sequence[str],
    artefacts: float,
    seed: int,
    bones: str,
) -> None:
    """Move the bones as they were moved, scan them and write the label map.

    executed: the plan as it was carried out; artefacts: multiple of the usual noise, metal, callus and streaks.
    """
    scan = scan_bones(
        head=read_segmentation(segmentation, case, label_values, segments),
        executed=Plan.read(executed, case),
        rng=generator(seed, "virtual_postop_bones", case),
        artefacts=artefacts,
    )
    write_segmentation(labels=scan.labels, spacing=scan.spacing, origin=scan.origin, path=bones)
