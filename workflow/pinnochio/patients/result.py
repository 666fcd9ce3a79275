"""What a method predicts of a new patient, whichever way it is made."""

import os
from dataclasses import asdict, dataclass
from functools import lru_cache

import numpy as np

from pinnochio.hdf5 import reading
from pinnochio.mechanics.solvers.inversion_repair import Repair
from pinnochio.model.patient import PatientModel
from pinnochio.model.predictions import Prediction, read_prediction
from pinnochio.model.regions import NOT_JUDGED
from pinnochio.statistics.intervals import Interval

read_patient = lru_cache(maxsize=1)(PatientModel.read)  # one for all stages of a process, with what they keep of it


def read_result(path: str | os.PathLike, case: str, patient: PatientModel) -> Interval:
    """The interval of an ensemble, or the prediction of a method without one: its half-width is NaN everywhere."""
    with reading(path) as file:
        if "half_width" in file:
            return Interval.read(path)
    points, skin = len(patient.points), len(patient.skin_points)
    made, nowhere = read_prediction(path, case), np.full(skin, NOT_JUDGED, np.int8)
    return Interval(made.displacement, np.zeros(points), np.full(skin, np.nan), nowhere, made.forces)


@dataclass(frozen=True)
class Solution:
    """How a new patient's field came about, as the certificate tells it.

    solver: whether one has carried the plan out; then converged, reason, iterations and load, the share of the plan
    that was reached. Of networks repaired: most elements that the inversion repair solved again in the mean field or in
    one model's; damping: its smallest factor on a whole field, 1 for none.
    """

    solver: bool = False
    converged: bool = True
    reason: str = ""
    iterations: int = 0
    load: float = 1.0
    repaired: int = 0
    damping: float = 1.0


def of_ensemble(path: str | os.PathLike, repair: Repair) -> Solution:
    """The solution of the models' predictions in a file, whose mean field was repaired."""
    with reading(path) as file:
        models = [dict(group.attrs) for group in file.values()]
    if (solved := models[0]).get("reason", Prediction.reason) != Prediction.reason:  # finite elements in their place
        return Solution(True, bool(solved["converged"]), solved["reason"], int(solved["iterations"]), solved["load"])
    repaired, damping = ([model.get(name, np.nan) for model in models] for name in ("repaired", "damping"))
    return Solution(
        converged=all(bool(model.get("converged", True)) for model in models),
        repaired=int(np.nanmax([repair.elements, *repaired])),
        damping=float(np.nanmin([repair.damping, *damping])),
    )


def read_solution(path: str | os.PathLike, case: str) -> Solution:
    """The solution of a result that :func:`read_result` reads."""
    with reading(path) as file:
        if "half_width" in file:
            values = {name: file.attrs[name] for name in asdict(Solution())}
            return Solution(**{key: value.item() if hasattr(value, "item") else value for key, value in values.items()})
    made = read_prediction(path, case)
    solver = made.reason != Prediction.reason
    return Solution(solver, made.converged, made.reason, made.iterations, made.load)
