"""The post-operative skin in the patient's frame: one reader and one check for the study and the planner."""

import os
from collections.abc import Mapping

import numpy as np

from pinnochio.importing.postop_bones import read_postop_bones
from pinnochio.importing.registration import Registration, measured, register, upper_face_plane
from pinnochio.importing.scan_checks import check_scan
from pinnochio.importing.segment_registration import check_fits, register_cranium
from pinnochio.importing.segmentation import read_labels, read_postop
from pinnochio.model.surfaces import BoneSurface, read_surface


def registered_skin(
    postop: str | os.PathLike,
    case: str,
    skin: str | os.PathLike,
    bone: str | os.PathLike,
    nasion_above_maxilla: float,
    limit: float,
    postop_bones: str = "",
    labels: str = "",
    segment_limit: float = 0.0,
    segment_share: float = 0.0,
    label_values: Mapping | str | None = None,
) -> tuple[Registration, np.ndarray, np.ndarray]:
    """The registration of a scan on the skin above the nasion plane, which surgery does not move; its points (k, 3) mm
    in its own frame and faces (l, 3), outward.

    skin, bone: files of the patient before surgery; nasion_above_maxilla (mm) places that plane above the maxilla;
    limit (mm) is the median residual above which the registration is refused (InputError), as is what is no scan of
    this face. With postop_bones, the bones of the same scan, the skin follows their cranium instead, registered on that
    of `labels` within segment_limit (mm) and segment_share (%); label_values: of those bones.
    """
    skin_points, skin_faces = read_surface(skin)
    points, faces = read_postop(postop, case, skin_points)
    surface = BoneSurface.read(bone)
    plane = upper_face_plane(surface, surface.segments, nasion_above_maxilla)
    by = {"case": case, "file": postop, "limit": limit}
    if postop_bones:
        scanned = read_postop_bones(postop_bones, case, surface.points, label_values)
        cranium, certainty = register_cranium(
            read_labels(labels), surface.segments, *scanned, case=case, file=postop_bones
        )
        check_fits([cranium], limit=segment_limit, share=segment_share, case=case, file=postop_bones)
        surfaces = (points, faces), (skin_points, skin_faces)
        fit = measured(cranium.motion.back, certainty, *surfaces, plane, surface, **by)
    else:
        fit = register(points, faces, skin_points, skin_faces, plane, bone=surface, **by)
    check_scan(points, faces, skin_points, skin_faces, plane, fit, case=case, file=postop)
    return fit, points, faces
