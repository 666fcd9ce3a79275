"""Makes the post-operative skin in the patient's own frame of the scan in any frame."""

import logging

from pinnochio.importing.registration import register, upper_face_plane
from pinnochio.importing.scan_checks import check_scan
from pinnochio.importing.segmentation import read_postop
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
) -> None:
    """Register the scan rigidly on the skin above the nasion plane, which surgery does not move.

    nasion_above_maxilla (mm) places that plane above the maxilla; limit (mm) is the median residual above
    which the registration is refused (InputError), as is what is no scan of this face. Writes points (k, 3) mm LPS,
    faces (l, 3) and the residual.
    """
    skin_points, skin_faces = read_surface(skin)
    points, faces = read_postop(postop, case, skin_points)
    surface = BoneSurface.read(bone)
    plane = upper_face_plane(surface, surface.segments, nasion_above_maxilla)
    fit = register(
        points=points,
        faces=faces,
        skin_points=skin_points,
        skin_faces=skin_faces,
        plane=plane,
        case=case,
        file=postop,
        limit=limit,
    )
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
    PostopSkin(fit.motion.apply(points), faces, fit.median).write(registered)


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
    )
