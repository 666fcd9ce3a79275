"""What bone motion does not explain of operated faces, learned as patterns of the face that mechanics carries.

Of each training patient the deviation of the post-operative skin from a base, a field in equilibrium with the bone, is
expressed by smooth patterns that correspond between faces (:mod:`pinnochio.model.face_modes`). Their amplitudes are
regressed on what is known before the scan: motion of the skeleton's places, soft tissue over the landmarks, covariates.
Of a new patient, loads under the skin bring them about (:mod:`pinnochio.mechanics.load_sources`). Both halves of a face
are alike, so every patient counts mirrored as well.
"""

import logging
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from pinnochio.geometry.closest_points import closest_points
from pinnochio.geometry.triangles import vertex_areas, vertex_normals
from pinnochio.hdf5 import reading, writing
from pinnochio.mechanics.load_sources import AnsweringTissue
from pinnochio.mechanics.settings import FemSettings
from pinnochio.model.bones import PLACES, motion_of_places
from pinnochio.model.correspondence import ACROSS, marks, sides_changed
from pinnochio.model.face_modes import SIGNS, FaceModes
from pinnochio.model.patient import PatientModel
from pinnochio.plans.plan import Plan
from pinnochio.training.regression import Regression, regress

SMOOTH = 1e-2  # of the patterns' mean square: what keeps amplitudes that the scan hardly shows small [X]
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
    """What a fold's training patients say of a new one.

    modes: the patterns; regression: of their amplitudes, mm; largest: mm, what the amplitudes of any training patient
    say at most of a point of the face, beyond which none is moved.
    """

    modes: FaceModes
    regression: Regression
    largest: float

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
        state = {name: np.asarray(value) for name, value in vars(self.modes).items()}
        state |= {_OF_REGRESSION + name: np.asarray(value) for name, value in vars(self.regression).items()}
        return state | {"largest": np.asarray(self.largest)}

    @classmethod
    def restored(cls, state: Mapping[str, np.ndarray]) -> "SourceModel":
        """From what :meth:`state` gave."""
        parts = {False: {}, True: {}}
        for name, value in state.items():
            parts[name.startswith(_OF_REGRESSION)][name.removeprefix(_OF_REGRESSION)] = value
        largest = float(parts[False].pop("largest"))
        return cls(FaceModes(**parts[False]), Regression(**parts[True]), largest)


class PatientSources:
    """The learned sources of one patient, made once for every plan; covariates: what else is known, by name."""

    def __init__(self, learned: SourceModel, model: PatientModel, fem: FemSettings, covariates: Mapping, tissue=None):
        """tissue: the patient's, where it serves several models. InputError where the face cannot be read."""
        self._learned, self._features = learned, Features(model, covariates)
        self.sources = (tissue or AnsweringTissue(model, fem))(learned.modes(model))

    def amplitudes(self, plan: Plan) -> np.ndarray:
        """Amplitudes (q,) under a plan, smaller in proportion where a point of the face would move by more than in any
        training patient."""
        row, _ = self._features(plan)
        amplitudes = self._learned.regression(row)
        largest = np.abs(self.sources.outward @ amplitudes).max()
        return amplitudes * min(1.0, self._learned.largest / max(largest, 1e-9))


def fit(
    models: Sequence[PatientModel],
    bases: Sequence[np.ndarray],
    plans: Sequence[Plan],
    skins: Sequence[tuple[np.ndarray, np.ndarray]],
    covariates: Sequence[Mapping],
) -> SourceModel:
    """The model of some training patients: fields (n, 3) mm that bone motion causes, plans, skins, covariates."""
    modes = FaceModes.of(models)
    rows, values, squares, largest = [], [], [], 0.0
    for model, base, plan, skin, known in zip(models, bases, plans, skins, covariates, strict=True):
        patterns = modes(model)
        square, amplitudes = deviation(model, base, skin, patterns)
        largest = max(largest, np.abs(patterns @ amplitudes).max())
        features = Features(model, known)
        rows += features(plan)
        values += [amplitudes, amplitudes * SIGNS]
        squares += [square, square * np.outer(SIGNS, SIGNS)]
    squares = np.array(squares)

    def on_skin(errors: np.ndarray) -> np.ndarray:
        # Errors count by how far they move the skin that the scan shows, mm^2.
        return np.einsum("ra,rab,rb->r", errors, squares, errors)

    owner = np.repeat(np.arange(len(models)), 2)
    regression = regress(np.array(rows), features.group, np.array(values), owner, on_skin)
    logging.info("amplitudes: %s, error %.2f of none's", regression.form, regression.error)
    return SourceModel(modes, regression, float(largest))


def deviation(model: PatientModel, base, skin: tuple, patterns: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """How a patient's post-operative skin (points, faces) deviates from the base (n, 3) mm along its normals, over the
    judged face that the scan shows: square (q, q) of the patterns (k, q), areas as weights, and amplitudes (q,) mm."""
    moved, face = model.moved_skin(base), model.judged_points
    near = closest_points(moved[face], *skin)
    away = np.einsum("kx,kx->k", near.points - moved[face], vertex_normals(moved, model.skin_faces)[face])
    area = vertex_areas(model.skin_points, model.skin_faces[model.face_roi])[face] * ~near.border
    area /= area.sum()
    square = (patterns.T * area) @ patterns
    penalty = SMOOTH * np.trace(square) / len(square) * np.eye(len(square))
    return square, np.linalg.solve(square + penalty, (patterns.T * area) @ away)


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


def _other_side(name: str) -> str:
    swap = {"left": "right", "right": "left"}
    stem, _, side = name.rpartition("_")
    return f"{stem}_{swap[side]}" if side in swap else name


def _value(covariates: Mapping, name: str) -> float:
    """A covariate as a number, NaN if it is not known."""
    value, code = covariates.get(name), CODES[name]
    return np.nan if value is None else float(code(value))
