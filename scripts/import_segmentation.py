"""Makes checked labels, bone and skin surfaces in LPS mm of a patient's segmentation and plan."""

import json

import numpy as np

from pinnochio.anatomy.labels import internal_codes
from pinnochio.anatomy.plan import Plan
from pinnochio.anatomy.segmentation import check_plan, read_segmentation, write_segmentation
from pinnochio.anatomy.surfaces import bone_surface, skin_surface, write_surface
from pinnochio.files import replacing
from pinnochio.logs import attach_log


def import_segmentation(
    case: str,
    segmentation: str,
    plan: str,
    label_values: dict[str, int],
    segments: tuple[str, ...],
    orientation: str,
    bone_edge: float,
    outputs: dict[str, str],
) -> None:
    """Read and check one patient; write labels, bone, skin, plan and a report of the volumes.

    label_values maps each structure's name to its voxel value; orientation is "header", or where the voxel axes point
    if the header is wrong; bone_edge is the edge length of the bone surface in mm; outputs names the files labels,
    bone, skin, plan and report. Raises InputError for what the user must mend.
    """
    checked = Plan.read(plan, case)
    check_plan(checked, segments, plan)
    head = read_segmentation(segmentation, case, label_values, segments, orientation)
    bone = bone_surface(head.labels, head.spacing, head.origin, segments, bone_edge)
    skin = skin_surface(head.labels, head.spacing, head.origin)
    voxel = float(np.prod(head.spacing)) / 1000
    report = {
        "case": case,
        "spacing_mm": np.asarray(head.spacing).tolist(),
        "shape": list(head.labels.shape),
        "volume_cm3": {
            name: round(voxel * int((head.labels == code).sum()), 3) for name, code in internal_codes(segments).items()
        },
    }
    write_segmentation(head.labels, head.spacing, head.origin, outputs["labels"])
    bone.write(outputs["bone"])
    write_surface(*skin, outputs["skin"])
    checked.write(outputs["plan"])
    with replacing(outputs["report"]) as temporary:
        temporary.write_text(json.dumps(report, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    attach_log(snakemake.log[0])
    import_segmentation(
        snakemake.wildcards.case,
        snakemake.input.segmentation,
        snakemake.input.plan,
        snakemake.params.labels,
        tuple(snakemake.params.segments),
        snakemake.params.orientation,
        snakemake.params.bone_edge,
        dict(snakemake.output.items()),
    )
