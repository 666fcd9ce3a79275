"""What solving only what a plan requires saves on one patient, and how far its face is from that of the whole."""

import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from pinnochio.mechanics.boundary.conditions import boundary_conditions
from pinnochio.mechanics.settings import FemSettings
from pinnochio.mechanics.simulation import Simulator
from pinnochio.model.patient import PatientModel
from pinnochio.plans.plan import Plan
from pinnochio.timing import REPEATS

PATIENCE = 2.0  # s of a first solve, above which it is not made again for the time of a further one


@dataclass(frozen=True)
class Way:
    """How a patient is solved: as of `Simulator`."""

    arm: str
    settings: FemSettings
    amplitude: float = 0.0

    def solver(self, patient: PatientModel) -> Simulator:
        """The solver of a patient."""
        return Simulator(patient, self.settings, self.arm, amplitude=self.amplitude)


@dataclass(frozen=True)
class Trial:
    """A solved plan: displacement (s, 3) mm of the skin's points; whether it converged; share of the cells that were
    solved; seconds of the processor: of deciding, beyond the boundary condition that any solve needs; of the patient
    and its first plan; of one more plan."""

    skin: np.ndarray
    converged: bool
    share: float
    deciding: float
    first: float
    further: float


def tried(patient: PatientModel, plan: Plan, way: Way) -> Trial:
    """Solve the plan as the first one of the patient, then again, as a further one."""
    began = time.process_time()
    solver = way.solver(patient)
    prepared = time.process_time()
    (result,) = solver.solve([plan])
    ended = time.process_time()
    further = ended - prepared
    if further < PATIENCE:
        solver.solve([plan])
        further = time.process_time() - ended
    share, deciding = 1.0, 0.0
    if way.amplitude:
        share = float(solver.required(plan).mean())
        deciding = _seconds(lambda: solver.required(plan)) - _seconds(
            lambda: boundary_conditions(patient, plan, way.arm)
        )
    solver.close()
    skin = patient.moved_skin(result.displacement) - patient.skin_points
    return Trial(skin, result.converged, share, deciding, ended - began, further)


def _seconds(call: Callable[[], object]) -> float:
    """Least seconds of the processor of some calls."""
    seconds = []
    for _ in range(REPEATS):
        start = time.process_time()
        call()
        seconds.append(time.process_time() - start)
    return min(seconds)


def face_error(patient: PatientModel, whole: Trial, trial: Trial) -> tuple[float, float]:
    """Mean and largest distance (mm) between the two displacements of the points of the judged face."""
    error = np.linalg.norm(trial.skin - whole.skin, axis=1)[patient.judged_points]
    return float(error.mean()), float(error.max())
