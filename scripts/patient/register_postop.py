"""Makes the post-operative skin in the patient's own frame of the scan in any frame."""

import logging

from pinnochio.importing.postop_bones import read_postop_bones
from pinnochio.importing.registration import measured, register, upper_face_plane
from pinnochio.importing.scan_checks import check_scan
from pinnochio.importing.segment_registration import check_fits, register_cranium
from pinnochio.importing.segmentation import read_labels, read_postop
from pinnochio.logs import attach_log
from pinnochio.model.postop import PostopSkin
from pinnochio.model.surfaces import BoneSurface, read_surface


def register_postop(
    case: str,
    postop: str,
    skin: str,
    bone: str,
    nasion_above_maxilla: float,
    limit: float,
    registered: str,
    postop_bones: str = "",
    labels: str = "",
    segment_limit: float = 0.0,
    segment_share: float = 0.0,
) -> None:
    """Register the scan rigidly on the skin above the nasion plane, which surgery does not move.

    nasion_above_maxilla (mm) places that plane above the maxilla; limit (mm) is the median residual above
    which the registration is refused (InputError), as is what is no scan of this face. With postop_bones, the bones of
    the same scan, the skin follows their cranium instead, registered on that of `labels` within segment_limit (mm) and
    segment_share (%). Writes points (k, 3) mm LPS, faces (l, 3), the residual and what is uncertain of the face.
    """
    skin_points, skin_faces = read_surface(skin)
    points, faces = read_postop(postop, case, skin_points)
    surface = BoneSurface.read(bone)
    plane = upper_face_plane(surface, surface.segments, nasion_above_maxilla)
    by = {"case": case, "file": postop, "limit": limit}
    if postop_bones:
        scanned = read_postop_bones(postop_bones, case, surface.points)
        cranium, certainty = register_cranium(
            read_labels(labels), surface.segments, *scanned, case=case, file=postop_bones
        )
        check_fits([cranium], limit=segment_limit, share=segment_share, case=case, file=postop_bones)
        surfaces = (points, faces), (skin_points, skin_faces)
        fit = measured(cranium.motion.back, certainty, *surfaces, plane, surface, **by)
    else:
        fit = register(points, faces, skin_points, skin_faces, plane, bone=surface, **by)
    check_scan(
        points=points,
        faces=faces,
        skin_points=skin_points,
        skin_faces=skin_faces,
        plane=plane,
        registration=fit,
        case=case,
        file=postop,
    )
    logging.info("residual: median %.3f mm, p95 %.3f mm", fit.median, fit.p95)
    logging.info("the face may be off by %.2f mm (p95), in the mean by %.2f mm (95%%)", fit.face_p95, fit.face_bias)
    PostopSkin(fit.motion.apply(points), faces, fit.median, fit.face_p95, fit.face_bias).write(registered)


if __name__ == "__main__":
    attach_log(snakemake.log[0])
    register_postop(
        case=snakemake.wildcards.case,
        postop=snakemake.input.postop,
        skin=snakemake.input.skin,
        bone=snakemake.input.bone,
        nasion_above_maxilla=snakemake.params.nasion_above_maxilla,
        limit=snakemake.params.limit,
        registered=snakemake.output.postop,
        postop_bones=snakemake.input.get("postop_bones", ""),
        labels=snakemake.input.get("labels", ""),
        segment_limit=snakemake.params.segment_limit,
        segment_share=snakemake.params.segment_share,
    )
