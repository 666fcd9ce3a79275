"""Forces on a virtual face: the tense skin, which no method models."""

from collections.abc import Mapping

import numpy as np

from pinnochio.geometry.mesh_topology import boundary_faces
from pinnochio.geometry.triangles import closest_on_triangles
from pinnochio.mechanics.boundary.loads import Loads
from pinnochio.model.patient import PatientModel

NASAL = "nasion", "pronasale", "subnasale"
MOUTH = "cheilion_right", "cheilion_left", "labrale_inferius"
SKIN = 1.2  # mm, thickness of epidermis and dermis of the face [R]
AT_MOUTH, IN_CHEEK, RISE = 7.0, 53.0, 25.0  # kPa, kPa [S: 10.1007/978-3-319-59764-5_6], mm from mouth and nose [I]
TENSION_SPREAD = 0.25  # CV over patients [S: 17-30 %]


def _from_triangle(points: np.ndarray, landmarks: Mapping[str, np.ndarray], *names: str) -> np.ndarray:
    """Distance (n,) mm of points from the triangle of three landmarks."""
    corners = np.stack([landmarks[name] for name in names])
    return np.linalg.norm(closest_on_triangles(points, np.tile(corners, (len(points), 1, 1)))[0] - points, axis=1)


def skin_tension(patient: PatientModel, landmarks: Mapping[str, np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """Triangles (f, 3) of the mesh that are outer skin and their published tension (f,) mN/mm."""
    on_skin = np.zeros(len(patient.points), bool)
    on_skin[patient.skin_nodes] = True
    faces, _ = boundary_faces(patient.cells)
    faces = faces[on_skin[faces].all(axis=1)]
    centre = patient.points[faces].mean(axis=1)
    away = np.minimum(*(_from_triangle(centre, landmarks, *place) for place in (MOUTH, NASAL)))
    return faces, SKIN * (IN_CHEEK + (AT_MOUTH - IN_CHEEK) * np.exp(-0.5 * (away / RISE) ** 2))


def loads(
    patient: PatientModel, landmarks: Mapping[str, np.ndarray], multiple: float, rng: np.random.Generator | None
) -> Loads | None:
    """What the tense skin does at this multiple of its published tension; rng: of the patient's own, None for the
    mean."""
    if not multiple:
        return None
    faces, tension = skin_tension(patient, landmarks)
    factor = 1.0
    if rng:
        spread = np.sqrt(np.log(1 + TENSION_SPREAD**2))
        factor = np.exp(rng.normal(-(spread**2) / 2, spread))
    return Loads(np.zeros_like(patient.points), faces, multiple * factor * tension)
