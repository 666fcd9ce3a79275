"""Makes repaired and checked labels, bone and skin surfaces in LPS mm of a patient's segmentation."""

import json

import numpy as np

from pinnochio.files import replacing
from pinnochio.importing.anatomy import check_anatomy
from pinnochio.importing.muscle_layer import muscle_layer
from pinnochio.importing.registration import upper_face_plane
from pinnochio.importing.repair import repair
from pinnochio.importing.segmentation import read_segmentation, write_segmentation
from pinnochio.logs import attach_log
from pinnochio.model.labels import internal_codes
from pinnochio.model.surfaces import bone_surface, skin_surface, write_surface


def import_segmentation(
    case: str,
    segmentation: str,
    label_values: dict[str, int | str],
    segments: tuple[str, ...],
    orientation: str,
    repair_limit: float,
    unlabelled_muscle: str,
    bone_edge: float,
    outputs: dict[str, str],
) -> None:
    """Read, repair and check one patient; write labels, bone, skin and a report of volumes and repairs.

    label_values maps each structure's name to its voxel value or to its name in the file; segments are those that a
    case may have, its own those that the file holds; orientation is "header", or
    where the voxel axes point if the header is wrong; repair_limit is the share of a structure in percent that repairs
    may change and unnamed voxels may take from it; unlabelled_muscle (derived | single | refuse) serves where no muscle
    is labelled; bone_edge is the edge length of the bone surface in mm; outputs names the files labels, bone, skin and
    report.
    Raises InputError for what the user must mend.
    """
    head = read_segmentation(
        path=segmentation,
        case=case,
        label_values=label_values,
        segments=segments,
        orientation=orientation,
        unnamed_percent=repair_limit,
    )
    voxel, segments = float(np.prod(head.spacing)), head.segments
    labels, repairs = repair(
        labels=head.labels, segments=segments, limit_percent=repair_limit, case=case, file=segmentation, voxel=voxel
    )
    frame = check_anatomy(
        labels=labels, spacing=head.spacing, segments=segments, axes=head.axes, case=case, file=segmentation
    )
    bone = bone_surface(labels=labels, spacing=head.spacing, origin=head.origin, segments=segments, edge_mm=bone_edge)
    top = upper_face_plane(bone, segments, 0.0)
    labels, muscle = muscle_layer(
        labels=labels,
        spacing=head.spacing,
        origin=head.origin,
        top=top,
        unlabelled=unlabelled_muscle,
        case=case,
        file=segmentation,
    )
    report = {
        "case": case,
        "spacing_mm": np.asarray(head.spacing).tolist(),
        "shape": list(labels.shape),
        "frame": frame,
        "muscle": muscle,
        "volume_cm3": {
            name: round(voxel / 1000 * int((labels == code).sum()), 3)
            for name, code in internal_codes(segments).items()
        },
        "repairs": repairs,
    }
    write_segmentation(labels=labels, spacing=head.spacing, origin=head.origin, path=outputs["labels"])
    bone.write(outputs["bone"])
    skin, skin_faces = skin_surface(labels, head.spacing, head.origin)
    write_surface(skin, skin_faces, outputs["skin"])
    with replacing(outputs["report"]) as temporary:
        temporary.write_text(json.dumps(report, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    attach_log(snakemake.log[0])
    import_segmentation(
        case=snakemake.wildcards.case,
        segmentation=snakemake.input.segmentation,
        label_values=snakemake.params.labels,
        segments=tuple(snakemake.params.segments),
        orientation=snakemake.params.orientation,
        repair_limit=snakemake.params.repair["limit"],
        unlabelled_muscle=snakemake.params.unlabelled_muscle,
        bone_edge=snakemake.params.bone_edge,
        outputs=dict(snakemake.output.items()),
    )
