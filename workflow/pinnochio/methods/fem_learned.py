"""Finite elements with sources: the bone's motion by mechanics, what it does not explain by a face that is held."""

import logging
import weakref
from collections.abc import Mapping, Sequence

import numpy as np

from pinnochio.mechanics.held_face import SHARES, HeldFace
from pinnochio.mechanics.settings import FemSettings
from pinnochio.mechanics.simulation import Simulator, simulate
from pinnochio.methods import sources
from pinnochio.methods.protocol import Planned
from pinnochio.methods.sources import PatientSources, SourceModel
from pinnochio.model.patient import PatientModel
from pinnochio.model.predictions import Prediction
from pinnochio.plans.plan import Plan
from pinnochio.timing import timed


def fit(
    models: Sequence[PatientModel],
    plans: Sequence[Plan],
    skins: Sequence[tuple[np.ndarray, np.ndarray]],
    fem: FemSettings,
    **_: object,
) -> SourceModel:
    """The sources of some training patients over the finite-element field of each one's own motion."""
    bases = []
    for model, plan in zip(models, plans, strict=True):
        (solved,) = simulate(model, [plan], fem)
        logging.info("%s: %s", plan.case, solved.reason)
        bases.append(solved.displacement)
    return sources.fit(models, bases, skins)


class LearnedLoadPredictor:
    """As :class:`pinnochio.methods.protocol.Predictor`; settings: fem."""

    def __init__(self, settings: Mapping, trained: str, device: str, threads: int):
        self._fem, self._learned, self._threads = FemSettings(**settings["fem"]), SourceModel.read(trained), threads

    def __call__(self, planned: Planned) -> Prediction:
        """Equilibrium under the plan, then with the face held; a solve that stops early is returned as such."""
        plan = planned.plan

        def prepare():
            learned, held, free, holding = planned.once(self._of_patient, planned.patient)

            def predict():
                base = free.solve([plan])[0].displacement
                wanted = learned(base)
                for share in SHARES:
                    pull = held.pull(share * wanted, base)
                    result = holding.solve([plan], [pull])[0]
                    if result.converged:
                        break
                return held.force(pull, result.displacement), result

            return predict

        (forces, result), seconds, setup = timed(prepare, planned.warm)
        logging.info("%s: %s", planned.case, result.reason)
        return Prediction(
            result.displacement,
            seconds,
            setup,
            self._threads,
            converged=result.converged,
            reason=result.reason,
            iterations=result.iterations,
            load=result.fraction,
            forces=forces,
        )

    def _of_patient(self, patient: PatientModel) -> tuple[PatientSources, HeldFace, Simulator, Simulator]:
        """What is learned, the springs, and the solvers without and with them."""
        held = HeldFace(patient, self._fem)
        solvers = Simulator(patient, self._fem), Simulator(patient, self._fem, loads=held.loads)
        for solver in solvers:
            weakref.finalize(held, solver.close)
        return PatientSources(self._learned, patient), held, *solvers
