"""Linear regression from the plan and the principal components of the face to the displacement of its skin.

Of the kind of Berends et al. 2025, who register a template to photographs before and after [S, abstract]; here the
landmarks of the face carry the template over. Fitted first to finite-element samples, then to what is left between its
predictions and the post-operative skins.
"""

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from functools import partial

import numpy as np

from pinnochio.geometry.closest_points import closest_points
from pinnochio.geometry.scattered import farthest, nearest, spread
from pinnochio.hdf5 import reading, writing
from pinnochio.methods.protocol import Planned, predict_skin
from pinnochio.model.bones import motion_of_places
from pinnochio.model.correspondence import corresponding, marks
from pinnochio.model.patient import PatientModel
from pinnochio.model.predictions import Prediction
from pinnochio.plans.plan import Plan

TEMPLATE = 400  # points
COMPONENTS = 5  # of the faces' shapes
PENALTIES = 10.0 ** np.arange(-3, 5)  # of the squared coefficients, of which leaving out one patient in turn chooses


@dataclass(frozen=True)
class LinearModel:
    """Template points (t, 3) and landmarks (l, 3) mm; mean (3 t,) and components (c, 3 t) of the shapes; scale (f,) of
    the features; pretrained and adapted (f + 1, 3 t) coefficients, mm, of the samples and of what the skins add.
    """

    template: np.ndarray
    landmarks: np.ndarray
    mean: np.ndarray
    components: np.ndarray
    scale: np.ndarray
    pretrained: np.ndarray
    adapted: np.ndarray

    def write(self, path: str | os.PathLike) -> None:
        """Write as HDF5."""
        with writing(path) as file:
            for item in fields(self):
                file.create_dataset(item.name, data=getattr(self, item.name), track_times=False)

    @classmethod
    def read(cls, path: str | os.PathLike) -> "LinearModel":
        """Read what :meth:`write` wrote."""
        with reading(path) as file:
            return cls(*(file[item.name][()] for item in fields(cls)))


class PcaPredictor:
    """As :class:`pinnochio.methods.protocol.Predictor`, without settings."""

    def __init__(self, settings: Mapping, trained: str | None, device: str, threads: int):
        self._linear, self._threads = LinearModel.read(trained), threads

    def __call__(self, planned: Planned) -> Prediction:
        """The skin alone; InputError where the face cannot be read."""
        return predict_skin(partial(LinearPredictor, self._linear), planned, self._threads)


class LinearPredictor:
    """A linear model on one patient: its shape is read once and serves every plan."""

    def __init__(self, linear: LinearModel, model: PatientModel):
        """InputError where the face cannot be read."""
        self._linear, self._model = linear, model
        shape = model.skin_points[corresponding(linear.template, linear.landmarks, model)]
        self._shape = linear.components @ (centred(shape) - linear.mean)
        self._near, self._weights = nearest(model.skin_points, shape)

    def __call__(self, plan: Plan) -> np.ndarray:
        """Displacement (s, 3) mm of the skin points."""
        regressors = np.append(features(self._model, plan, self._shape) / self._linear.scale, 1)
        moved = (regressors @ (self._linear.pretrained + self._linear.adapted)).reshape(-1, 3)
        return spread(moved, self._near, self._weights)


def fit(
    models: Sequence[PatientModel],
    fem_samples: Sequence[Sequence[tuple[Plan, np.ndarray]]],
    plans: Sequence[Plan],
    skins: Sequence[tuple[np.ndarray, np.ndarray]],
) -> LinearModel:
    """The model of some training patients: their finite-element samples (plan, (n, 3) mm), own plans and skins.

    The first patient's face is the template.
    """
    first = models[0]
    face = first.judged_points
    template = first.skin_points[face][farthest(first.skin_points[face], TEMPLATE)]
    landmarks = marks(first)
    places = [corresponding(template, landmarks, model) for model in models]
    shapes = np.array([centred(model.skin_points[place]) for model, place in zip(models, places, strict=True)])
    mean = shapes.mean(axis=0)
    components = np.linalg.svd(shapes - mean, full_matrices=False)[2][: min(COMPONENTS, len(models) - 1)]
    scores = (shapes - mean) @ components.T

    rows, values, owner = [], [], []
    for number, (model, place) in enumerate(zip(models, places, strict=True)):
        for plan, field in fem_samples[number]:
            rows.append(features(model, plan, scores[number]))
            values.append((model.moved_skin(field) - model.skin_points)[place].ravel())
            owner.append(number)
    scale = np.std(rows, axis=0)
    scale[scale < 1e-9] = 1.0
    coefficients = ridge(np.array(rows) / scale, np.array(values), np.array(owner))

    rows, rest = [], []
    for number, (model, place) in enumerate(zip(models, places, strict=True)):
        rows.append(features(model, plans[number], scores[number]) / scale)
        moved = model.skin_points[place] + (np.append(rows[-1], 1) @ coefficients).reshape(-1, 3)
        at = closest_points(moved, *skins[number])
        rest.append(np.where(at.border[:, None], np.nan, at.points - moved).ravel())
    rest = np.array(rest)
    known = np.isfinite(rest)
    usual = np.where(known, rest, 0).sum(axis=0) / np.maximum(known.sum(axis=0), 1)
    adapted = ridge(np.array(rows), np.where(known, rest, usual), np.arange(len(models)))
    return LinearModel(template, landmarks, mean, components, scale, coefficients, adapted)


def features(model: PatientModel, plan: Plan, shape: np.ndarray) -> np.ndarray:
    """What is regressed on: the displacement (mm) of fixed places of the skeleton, whichever segments carry them, and
    the shape; so cases that are cut differently have the same features."""
    return np.concatenate([*motion_of_places(model, plan).values(), shape])


def ridge(rows: np.ndarray, values: np.ndarray, owner: np.ndarray) -> np.ndarray:
    """Coefficients (f + 1, v) from rows (r, f) to values (r, v), the last for the free constant.

    The penalty is the one of PENALTIES that predicts each owner's (r,) rows best from those of all others.
    """
    with_one = np.column_stack([rows, np.ones(len(rows))])

    def solve(chosen, penalty):
        x, y = with_one[chosen], values[chosen]
        weight = np.append(np.full(rows.shape[1], penalty), 1e-9)
        return np.linalg.solve(x.T @ x + np.diag(weight), x.T @ y)

    def error(penalty):
        parts = [(with_one[owner == n] @ solve(owner != n, penalty) - values[owner == n]) for n in np.unique(owner)]
        return np.square(np.concatenate(parts)).mean()

    return solve(slice(None), min(PENALTIES, key=error))


def centred(points: np.ndarray) -> np.ndarray:
    """Coordinates (3 p,) about the middle of the points."""
    return (points - points.mean(axis=0)).ravel()
