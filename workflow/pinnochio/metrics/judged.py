"""Where a case is judged: samples of scan and skin and their regions, chosen once by a surface that no method makes."""

import os
from dataclasses import dataclass, field, fields

import numpy as np
from scipy.spatial import cKDTree

from pinnochio.errors import InputError
from pinnochio.geometry.alignment import carried
from pinnochio.geometry.closest_points import Closest, closest_points
from pinnochio.geometry.triangles import face_normals, sample_surface
from pinnochio.hdf5 import reading, writing
from pinnochio.model.patient import PatientModel
from pinnochio.model.regions import NECK, NOT_JUDGED, regions
from pinnochio.plans.plan import Plan

BONE = 30  # points of the bone nearest to a point of the skin, whose mean motion it is first sought by
SHOWN = 2.0  # mm within which the skin that is carried onto the scan has to lie to it where both show the face [X]
AROUND = 25.0  # mm about the judged face that is fitted to the scan too, so that it is held at its edges


@dataclass(frozen=True)
class Judged:
    """What every method of a case is judged by.

    target (k, 3) mm: samples of the registered scan; skin (j, 3) mm: samples of the skin before surgery, which a method
    carries along. target_region (k,), skin_region (j,) int8: index into `regions.NAMES`, NOT_JUDGED where the face
    cannot be read. neck (n, 3) mm: samples of the scan below the jaw, whose errors are shown and count nowhere.
    """

    target: np.ndarray
    target_region: np.ndarray
    skin: np.ndarray
    skin_region: np.ndarray
    neck: np.ndarray = field(default_factory=lambda: np.zeros((0, 3)))

    def before(self, patient: PatientModel) -> Closest:
        """The samples of the skin on a model of the case before surgery, to be carried where its skin moves.

        The models of a case share one skin, but for some triangles between the lips.
        """
        return closest_points(self.skin, patient.skin_points, patient.skin_faces)

    def write(self, path: str | os.PathLike) -> None:
        """Write as HDF5."""
        with writing(path) as file:
            for item in fields(self):
                file.create_dataset(item.name, data=getattr(self, item.name), compression="gzip", track_times=False)

    @classmethod
    def read(cls, path: str | os.PathLike) -> "Judged":
        """Read what :meth:`write` wrote."""
        with reading(path) as file:
            return cls(**{item.name: file[item.name][()] for item in fields(cls)})


def choose(patient: PatientModel, plan: Plan, target_points, target_faces, samples: int, seed: int) -> Judged:
    """Area-uniform samples of either surface in the part of the face that both show, and the region of each.

    `samples` are drawn over face and neck, so that those of the face alone, which count, are about a fifth fewer.

    The surface that decides is the skin before surgery carried smoothly onto the scan itself
    (:func:`pinnochio.geometry.alignment.carried`): no method has a part in it, and the plan none but to say about where
    the jaws have gone, so that the search does not begin with a lip before the other one. A sample of the scan is
    judged if its closest point there lies on a judged face, not on an open border, and near; one of the skin if it is
    judged and the same holds of its closest point on the scan. So nothing counts that one of them alone shows, such as
    the base of the nose, which no camera sees. Either then counts for every method, wherever the method takes the skin:
    nothing is dropped later. A sample's region is that of the nearest point of the
    skin before surgery, of the scan by the carried one.

    Closest points of the skin where it was would do without the alignment; but where a jaw has moved by 10 mm the lip
    is then taken for the other lip. Landmarks read on the scan itself need bone, which no scan shows. Measured against
    the truth: docs/reference/metrics.md.

    InputError where the surfaces share no region.
    """
    points, faces, roi = patient.skin_points, patient.skin_faces, patient.face_roi
    if not roi.any():
        raise InputError(plan.case, "model", "no skin face is in the judged region", "check the segmentation's frame")
    centre = points[faces].mean(axis=1)
    part = cKDTree(centre[roi]).query(centre, distance_upper_bound=AROUND)[0] <= AROUND
    near = cKDTree(patient.bone_points).query(points, BONE)[1]
    start = points + patient.bone_displacement(plan)[near].mean(axis=1)
    placed = carried(points, faces, target_points, target_faces, part, start, seed)
    codes = known_regions(patient)

    skin = sample_surface(points, faces[roi], samples, seed)
    shown = _near(closest_points(closest_points(skin, points, faces).carried(placed), target_points, target_faces))
    rest = closest_points(skin[shown], points, faces)
    ratio = face_normals(target_points, target_faces)[1].sum() / face_normals(points, faces[roi])[1].sum()
    many = int(np.ceil(samples * np.clip(ratio, 1, 5)))
    queries = sample_surface(target_points, target_faces, many, seed + 1)
    closest = closest_points(queries, placed, faces)
    kept = _near(closest) & roi[closest.face]
    if not (shown.any() and kept.any()):
        raise InputError(
            plan.case, "postop", "the scan covers nothing of the judged face", "check scan and registration"
        )
    target, region = queries[kept], _nearest(codes, closest, placed, faces)[kept]
    skin, skin_region = skin[shown], _nearest(codes, rest, points, faces)
    face, skin_face = region != NECK, skin_region != NECK
    if not (face.any() and skin_face.any()):
        raise InputError(plan.case, "postop", "the scan covers nothing but the neck", "check scan and registration")
    return Judged(target[face], region[face], skin[skin_face], skin_region[skin_face], target[~face])


def _near(closest: Closest) -> np.ndarray:
    """Whether what was sought (k,) is there: near, and not beyond an open border."""
    return ~closest.border & (closest.distance < SHOWN)


def known_regions(patient: PatientModel) -> np.ndarray:
    """Region (s,) of every skin point; NOT_JUDGED where the face cannot be read."""
    try:
        return regions(patient)
    except InputError:
        return np.full(len(patient.skin_points), NOT_JUDGED, np.int8)


def _nearest(codes, closest: Closest, points, faces) -> np.ndarray:
    """Code (k,) of the corner nearest to each closest point on a surface."""
    corners = faces[closest.face]
    nearest = np.linalg.norm(points[corners] - closest.points[:, None], axis=2).argmin(axis=1)
    return codes[corners[np.arange(len(corners)), nearest]]
