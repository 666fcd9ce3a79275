"""What every method offers: a predictor that is made once and predicts patient after patient."""

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Protocol, TypeVar

import numpy as np

from pinnochio.mechanics.lift import Lift
from pinnochio.model.patient import PatientModel
from pinnochio.model.predictions import Prediction
from pinnochio.plans.plan import Plan

Result = TypeVar("Result")


@dataclass(frozen=True)
class Planned:
    """A patient under a plan; lift: of a method whose network wants one; truth: file of the virtual one, of a bound;
    covariates: what else is known of the patient, by name, of a method that reads them; warm: as of `timing.timed`."""

    case: str
    patient: PatientModel
    plan: Plan
    lift: Lift | None = None
    truth: str | None = None
    covariates: Mapping = field(default_factory=dict)
    warm: bool = True
    _made: dict = field(default_factory=dict, compare=False)

    def once(self, make: Callable[..., Result], *arguments) -> Result:
        """make(*arguments), made once for all that predict a patient, and for all of its plans. Unless `make` is a
        predictor's method, the first one's serves all predictors: nothing of what one has learned goes in."""
        if make not in self._made:
            self._made[make] = make(*arguments)
        return self._made[make]


class Predictor(Protocol):
    """Predicts how the soft tissue follows a plan."""

    def __init__(self, settings: Mapping, trained: str | None, device: str, threads: int):
        """settings: values of the configuration's sections that the method reads; trained: file of what a fold trained,
        None of a method without training; device: "cpu" or "cuda"; threads: of the processor."""

    def __call__(self, planned: Planned) -> Prediction:
        """The prediction with its timings; FloatingPointError if a field is not finite."""


def predict_skin(
    of_patient: Callable[[PatientModel], Callable[[Plan], np.ndarray]], planned: Planned, threads: int
) -> Prediction:
    """The skin alone: of_patient(patient)(plan) (s, 3) mm, timed once, the patient apart from the plan."""
    began = time.perf_counter()
    displacement = of_patient(planned.patient)
    ready = time.perf_counter()
    skin = displacement(planned.plan)
    return Prediction(None, time.perf_counter() - ready, ready - began, threads, skin=skin)
