"""Forces on a virtual face: the weight that turns when the patient sits up, and the tense skin.

The learned methods know the form of the first but for the nose (mechanics/load_sources.py). No method models the
second.
"""

from collections.abc import Mapping

import numpy as np

from pinnochio.geometry.mesh_topology import boundary_faces
from pinnochio.geometry.triangles import closest_on_triangles
from pinnochio.mechanics.boundary.loads import Loads
from pinnochio.mechanics.elements.tetrahedra import node_volumes
from pinnochio.model.patient import PatientModel
from pinnochio.virtual.covariates import AGE, Covariates

WEIGHT = 1e-3 * 9.81  # mN/mm3, tissue of 1 g/cm3 [R]
NASAL = "nasion", "pronasale", "subnasale"
MOUTH = "cheilion_right", "cheilion_left", "labrale_inferius"
LYING, UPRIGHT = np.array([0.0, 1, 0]), np.array([0.0, 0, -1])  # where down is, LPS
MORE_WITH_MASS, MORE_WITH_AGE = 0.25, 0.01  # of the load, per SD of body mass and per year [S direction, I size]
LEAST_LOAD = 0.3  # of the mean [I]
NOSE = 14.0  # mm about the line from nasion to subnasale and tip, where cartilage carries the weight [I]
SKIN = 1.2  # mm, thickness of epidermis and dermis of the face [R]
AT_MOUTH, IN_CHEEK, RISE = 7.0, 53.0, 25.0  # kPa, kPa [S: 10.1007/978-3-319-59764-5_6], mm from mouth and nose [I]
TENSION_SPREAD = 0.25  # CV over patients [S: 17-30 %]


def sag(covariates: Covariates) -> float:
    """How much more than the mean the tissue of a patient gives way to its weight: more with body mass and age.

    It stands for softer and more tissue; as a factor on the load it changes nothing of how tissue follows bone.
    """
    more = 1 + MORE_WITH_MASS * covariates.mass + MORE_WITH_AGE * (covariates.age - AGE[0])
    return max(more, LEAST_LOAD)


def weight_change(patient: PatientModel, landmarks: Mapping[str, np.ndarray], amount: float) -> np.ndarray:
    """Force (n, 3) mN at the nodes: the weight upright less the weight lying, in which the CT is in equilibrium; none
    in the nose, which hangs on cartilage."""
    volume = node_volumes(patient.points, patient.cells)
    hanging = 1 - np.exp(-0.5 * (_from_triangle(patient.points, landmarks, *NASAL) / NOSE) ** 2)
    return amount * WEIGHT * (hanging * volume)[:, None] * (UPRIGHT - LYING)


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
    patient: PatientModel,
    landmarks: Mapping[str, np.ndarray],
    covariates: Covariates,
    posture: float,
    pre_stress: float,
    rng: np.random.Generator,
) -> Loads | None:
    """What acts on the face at these multiples of posture and pre-stress; rng: of the patient's own tension."""
    if not posture and not pre_stress:
        return None
    forces = weight_change(patient, landmarks, posture * sag(covariates))
    faces, tension = np.zeros((0, 3), int), np.zeros(0)
    if pre_stress:
        faces, tension = skin_tension(patient, landmarks)
        spread = np.sqrt(np.log(1 + TENSION_SPREAD**2))
        tension = pre_stress * np.exp(rng.normal(-(spread**2) / 2, spread)) * tension
    return Loads(forces, faces, tension)
