"""Landmarks carried by the skin: where a displacement of the mesh takes them, as a linear map."""

from dataclasses import dataclass

import numpy as np
from scipy import sparse
from scipy.spatial import cKDTree

from pinnochio.model.landmarks import FaceLandmarks, face_landmarks, subspinale, unseen
from pinnochio.model.measures import LANDMARKS
from pinnochio.model.patient import LOWER_LIP, UPPER_LIP, PatientModel

NEAR = 4.0  # mm about a landmark over which the skin is averaged [I]
COLUMELLA = 0.45  # share of the way from subnasale to the tip of the nose, below which the columella lies [I]
MIDDLE = 8.0  # mm from the midline: the middle of the lips' edges [I]
EDGE = 4.0  # mm behind the foremost node of a lip: its edge on a mesh of 5 mm [I]
OF_UPPER = ("labrale_superius", "subspinale")
OF_LOWER = ("labrale_inferius", "sublabiale")


@dataclass(frozen=True)
class CarriedLandmarks:
    """positions (k, 3) mm LPS of LANDMARKS before surgery, NaN where unknown; carriers (k, n): weights of the nodes,
    one in sum, whose displacement each landmark takes. So a landmark is a point of the tissue: it stays the same point
    where the plan turns the face under it."""

    positions: np.ndarray
    carriers: sparse.csr_array

    def moved(self, displacement: np.ndarray) -> np.ndarray:
        """Positions (k, 3) mm under a displacement (n, 3) mm of the mesh."""
        return self.positions + self.carriers @ displacement


def carried_landmarks(patient: PatientModel, marks: FaceLandmarks | None = None) -> CarriedLandmarks:
    """The LANDMARKS of a patient, each carried by the skin within NEAR of it, a lip's by its own side of the mouth.

    The edges of the lips are the mean of the foremost nodes of each lip at the middle of the mouth; without a mouth
    slit in the mesh they are unknown. marks: None for face_landmarks(patient), of which those that are
    :func:`unseen` are unknown. InputError where the face cannot be read.
    """
    hidden = () if marks else unseen(patient, face_landmarks(patient))
    marks = marks or face_landmarks(patient)
    places = vars(marks) | {
        "subspinale": subspinale(patient, marks),
        "columella": columella(patient, marks.subnasale, marks.pronasale),
    }
    places |= {"alare_right": marks.alare[0], "alare_left": marks.alare[1]}
    height = patient.skin_points[:, 2] - marks.stomion[2]
    positions, rows = np.full((len(LANDMARKS), 3), np.nan), []
    for row, name in enumerate(LANDMARKS):
        if name in ("stomion_superius", "stomion_inferius"):
            edge = _edge(patient, UPPER_LIP if name == "stomion_superius" else LOWER_LIP, marks.stomion[0])
            weights = np.zeros(len(patient.points))
            if len(edge):
                positions[row] = patient.points[edge].mean(axis=0)
                weights[edge] = 1 / len(edge)
            rows.append(sparse.csr_array(weights[None]))
            continue
        positions[row] = np.nan if name in hidden else places[name]
        allowed = height > 0 if name in OF_UPPER else height < 0 if name in OF_LOWER else None
        rows.append(carriers(patient, places[name], allowed))
    return CarriedLandmarks(positions, sparse.vstack(rows, format="csr"))


def carriers(patient: PatientModel, place: np.ndarray, allowed: np.ndarray | None = None) -> sparse.csr_array:
    """Weights (1, n) of the nodes whose mean displacement the skin within NEAR of a place (3,) mm takes.

    allowed (s,) bool: the skin points that may count. Where none is so near, the nearest counts.
    """
    skin = np.unique(patient.skin_faces)
    skin = skin if allowed is None else skin[allowed[skin]]
    tree = cKDTree(patient.skin_points[skin])
    near = skin[tree.query_ball_point(place, NEAR) or [tree.query(place)[1]]]
    weights = np.zeros(len(patient.points))
    np.add.at(weights, patient.skin_nodes[near], patient.skin_weights[near] / len(near))
    return sparse.csr_array(weights[None])


def columella(patient: PatientModel, subnasale: np.ndarray, pronasale: np.ndarray) -> np.ndarray:
    """The skin point (3,) mm nearest to the way from subnasale to the tip of the nose, below the columella."""
    skin = np.unique(patient.skin_faces)
    between = subnasale + COLUMELLA * (pronasale - subnasale)
    return patient.skin_points[skin[cKDTree(patient.skin_points[skin]).query(between)[1]]]


def _edge(patient: PatientModel, lip: int, middle: float) -> np.ndarray:
    """The foremost nodes (k,) of a lip at the middle of the mouth; of a lip that has none there, the nearest one."""
    nodes = np.flatnonzero(patient.lip == lip)
    across = np.abs(patient.points[nodes, 0] - middle)
    nodes = nodes[across <= max(MIDDLE, across.min(initial=np.inf))]
    return nodes[patient.points[nodes, 1] <= patient.points[nodes, 1].min(initial=np.inf) + EDGE]
