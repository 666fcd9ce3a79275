"""What bone motion does not explain of operated faces, learned as amplitudes of sources that mechanics carries.

Of each training patient the deviation of the post-operative skin from a base, a field in equilibrium with the bone, is
expressed by sources (:mod:`pinnochio.mechanics.load_sources`): pressures about corresponding anchors of the face and
the weight of the tissue as the patient sits up. The amplitudes are regressed on what is known before the scan: motion
of the skeleton's places, soft tissue over the landmarks, covariates. Both halves of a face are alike, so every patient
counts mirrored as well.
"""

import logging
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from pinnochio.geometry.closest_points import closest_points
from pinnochio.geometry.scattered import farthest
from pinnochio.geometry.triangles import vertex_areas, vertex_normals
from pinnochio.hdf5 import reading, writing
from pinnochio.mechanics.load_sources import Sources, make_sources
from pinnochio.mechanics.settings import FemSettings
from pinnochio.model.bones import PLACES, motion_of_places
from pinnochio.model.correspondence import ACROSS, SIDES, corresponding, marks, mirrored_marks, sides_changed
from pinnochio.model.patient import PatientModel
from pinnochio.plans.plan import Plan
from pinnochio.training.regression import Regression, regress

ANCHORS = 36  # of one half of a face, about 16 mm apart
MIDLINE = 3.0  # mm from it on which no anchor stands
SMOOTH = 3e-3  # of the sources' mean response: what keeps amplitudes that the scan hardly shows small [I]
_OF_REGRESSION = "regression_"  # begins the names of its parts
MOTION, TISSUE, COVARIATES = range(3)  # groups of features
# Covariates as numbers; swelling goes with the logarithm of time.
CODES = {
    "sex": lambda value: value == "female",
    "age": float,
    "bmi": float,
    "months": lambda value: np.log(max(value, 0.5)),
    "closure": lambda value: value == "vy",
    "cinch": bool,
}


@dataclass(frozen=True)
class SourceModel:
    """What a fold's training patients say of the sources of a new one.

    anchors (a, 3) mm of the right half of a face and landmarks (l, 3) mm of the template that they stand on; weight:
    amplitude of the weight's turn, the same for everyone; regression: of the 2 a amplitudes at the anchors, mm, those
    of the right half first.
    """

    anchors: np.ndarray
    landmarks: np.ndarray
    weight: float
    regression: Regression

    def write(self, path: str | os.PathLike) -> None:
        """Write as HDF5."""
        with writing(path) as file:
            for name, value in self.state().items():
                file.create_dataset(name, data=value, track_times=False)

    @classmethod
    def read(cls, path: str | os.PathLike) -> "SourceModel":
        """Read what :meth:`write` wrote."""
        with reading(path) as file:
            return cls.restored({name: value[()] for name, value in file.items()})

    def state(self) -> dict[str, np.ndarray]:
        """Everything as arrays, by name."""
        state = {name: np.asarray(getattr(self, name)) for name in ("anchors", "landmarks", "weight")}
        return state | {_OF_REGRESSION + name: np.asarray(value) for name, value in vars(self.regression).items()}

    @classmethod
    def restored(cls, state: Mapping[str, np.ndarray]) -> "SourceModel":
        """From what :meth:`state` gave."""
        values = {name: value for name, value in state.items() if not name.startswith(_OF_REGRESSION)}
        regression = {name.removeprefix(_OF_REGRESSION): state[name] for name in state if name not in values}
        return cls(**values | {"weight": float(values["weight"])}, regression=Regression(**regression))


class PatientSources:
    """The learned sources of one patient, made once for every plan; covariates: what else is known, by name."""

    def __init__(self, learned: SourceModel, model: PatientModel, fem: FemSettings, covariates: Mapping):
        """InputError where the face cannot be read."""
        self._learned, self._features = learned, Features(model, covariates)
        self.sources = sources_of(model, learned.anchors, learned.landmarks, fem)

    def amplitudes(self, plan: Plan) -> np.ndarray:
        """Amplitudes (2 a + 1,) under a plan."""
        row, _ = self._features(plan)
        return np.append(self._learned.regression(row), self._learned.weight)


def fit(
    models: Sequence[PatientModel],
    bases: Sequence[np.ndarray],
    plans: Sequence[Plan],
    skins: Sequence[tuple[np.ndarray, np.ndarray]],
    covariates: Sequence[Mapping],
    fem: FemSettings,
) -> SourceModel:
    """The model of some training patients: fields (n, 3) mm that bone motion causes, plans, skins, covariates.

    The first patient's face is the template.
    """
    first = models[0]
    landmarks, face = marks(first), first.skin_points[first.judged_points]
    half = face[face[:, 0] < landmarks[: -len(SIDES), 0].mean() - MIDLINE]
    anchors = half[farthest(half, ANCHORS)]

    deviations, rows, owner = [], [], []
    for number, (model, base, plan, skin, known) in enumerate(
        zip(models, bases, plans, skins, covariates, strict=True)
    ):
        deviations.append(Deviation.of(model, base, skin, sources_of(model, anchors, landmarks, fem)))
        features = Features(model, known)
        rows += features(plan)
        owner += [number, number]
    weight = sum(each.on_weight for each in deviations) / sum(each.of_weight for each in deviations)
    values, squares = [], []
    for each in deviations:
        solved, square = each.amplitudes(weight), each.square[:-1, :-1]
        values += [solved, np.roll(solved, len(anchors))]
        squares += [square, np.roll(square, (len(anchors), len(anchors)), axis=(0, 1))]
    squares = np.array(squares)

    def on_skin(errors: np.ndarray) -> np.ndarray:
        # Several amplitudes together may hardly move the skin: errors count by how far they move it, mm^2.
        return np.einsum("ra,rab,rb->r", errors, squares, errors)

    regression = regress(np.array(rows), features.group, np.array(values), np.array(owner), on_skin)
    logging.info(
        "weight %.2f of a turn; amplitudes: %s, error %.2f of none's", weight, regression.form, regression.error
    )
    return SourceModel(anchors, landmarks, float(weight), regression)


def sources_of(model: PatientModel, anchors: np.ndarray, landmarks: np.ndarray, fem: FemSettings) -> Sources:
    """The sources of a patient at the places of a template's anchors (a, 3) mm, and at those of their mirror images."""
    places = (
        corresponding(anchors, landmarks, model),
        corresponding(anchors * ACROSS, mirrored_marks(landmarks), model),
    )
    return make_sources(model, fem.material(model.tissue), np.concatenate(places), fem.volumetric)


class Features:
    """What amplitudes are regressed on; of the patient itself it is found once for every plan.

    Motion (mm) of the skeleton's places, to the front and to the back apart, because lips follow these differently;
    distance (mm) of the landmarks from bone, gap of the lips; covariates, NaN where they are not known.
    """

    def __init__(self, model: PatientModel, covariates: Mapping):
        """InputError where the face cannot be read."""
        landmarks = marks(model)
        depth, _ = cKDTree(model.bone_points).query(landmarks)
        known = [landmarks[3, 2] - landmarks[5, 2], *(_value(covariates, name) for name in CODES)]
        self._model = model
        self._still = [np.append(depths, known) for depths in (depth, sides_changed(depth))]
        self.group = np.repeat((MOTION, TISSUE, COVARIATES), (4 * len(PLACES), len(landmarks) + 1, len(CODES)))

    def __call__(self, plan: Plan) -> tuple[np.ndarray, np.ndarray]:
        """The features (f,) under a plan, and the same of the mirrored patient."""
        moved, rows = motion_of_places(self._model, plan), []
        for still, side, sign in zip(self._still, (str, _other_side), (1, ACROSS), strict=True):
            motion = np.array([moved[side(name)] for name in PLACES]) * sign
            rows.append(np.concatenate([motion.ravel(), np.maximum(motion[:, 1], 0), still]))
        return tuple(rows)


@dataclass(frozen=True)
class Deviation:
    """Of a post-operative skin from a base, along its normals: normal equations of amplitudes, areas as weights.

    square (q, q), side (q,) of the sources, the weight's turn last.
    """

    square: np.ndarray
    side: np.ndarray

    @classmethod
    def of(cls, model: PatientModel, base: np.ndarray, skin: tuple[np.ndarray, np.ndarray], sources: Sources):
        """Of a patient's skin (points, faces) from the base (n, 3) mm, over the judged face that the scan shows."""
        moved = model.moved_skin(base)
        normals, face = vertex_normals(moved, model.skin_faces), model.judged_points
        near = closest_points(moved[face], *skin)
        away = np.einsum("kx,kx->k", near.points - moved[face], normals[face])
        area = vertex_areas(model.skin_points, model.skin_faces[model.face_roi])[face] * ~near.border
        outward = np.stack(
            [
                np.einsum("kx,kx->k", (model.moved_skin(field) - model.skin_points)[face], normals[face])
                for field in sources.fields
            ]
        )
        area /= area.sum()
        return cls((outward * area) @ outward.T, (outward * area) @ away)

    @property
    def on_weight(self) -> float:
        """How much of the deviation goes with the weight's turn."""
        return self.side[-1]

    @property
    def of_weight(self) -> float:
        """The square of the weight's turn."""
        return self.square[-1, -1]

    def amplitudes(self, weight: float) -> np.ndarray:
        """Amplitudes (a,) of the other sources beside that of the weight."""
        square, side = self.square[:-1, :-1], self.side[:-1] - weight * self.square[-1, :-1]
        return np.linalg.solve(square + SMOOTH * np.trace(square) / len(square) * np.eye(len(square)), side)


def _other_side(name: str) -> str:
    swap = {"left": "right", "right": "left"}
    stem, _, side = name.rpartition("_")
    return f"{stem}_{swap[side]}" if side in swap else name


def _value(covariates: Mapping, name: str) -> float:
    """A covariate as a number, NaN if it is not known."""
    value, code = covariates.get(name), CODES[name]
    return np.nan if value is None else float(code(value))
