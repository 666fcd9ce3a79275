"""A plan solved on a reduced model, and how far its face is from that of the full one."""

import time
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from pinnochio.mechanics.elastic import ElasticSolver
from pinnochio.mechanics.settings import FemSettings
from pinnochio.mechanics.simulation import simulate
from pinnochio.mechanics.sliding import boundary_conditions
from pinnochio.model.patient import PatientModel
from pinnochio.plans.plan import Plan


@dataclass(frozen=True)
class Trial:
    """A solved plan: displacement (s, 3) mm of the skin's points, seconds of the solve, whether it converged."""

    skin: np.ndarray
    seconds: float
    converged: bool


def solve_scene(patient: PatientModel, plan: Plan, elastic: bool, fem: FemSettings) -> Trial:
    """Solve with sliding interfaces, as far as the model has them, by linear elasticity or Newton's method."""
    start = time.perf_counter()
    if elastic:
        boundary = boundary_conditions(patient, plan, "mucosa")
        material = fem.material(patient.tissue)
        solver = ElasticSolver(patient.points, patient.cells, material, boundary, fem.volumetric, fem.linear_solver)
        displacement, converged = solver.solve(boundary), True
        solver.close()
    else:
        result = simulate(patient, plan, "mucosa", fem)
        displacement, converged = result.displacement, result.converged
    seconds = time.perf_counter() - start
    return Trial(patient.moved_skin(displacement) - patient.skin_points, seconds, converged)


def face_error(full: PatientModel, reference: Trial, patient: PatientModel, trial: Trial) -> tuple[float, float]:
    """Mean and largest distance (mm) between the two displacements of the points of the full model's judged face.

    A point that the other model's skin lacks is compared with its nearest one.
    """
    face = full.judged_points
    _, nearest = cKDTree(patient.skin_points).query(full.skin_points[face])
    error = np.linalg.norm(trial.skin[nearest] - reference.skin[face], axis=1)
    return float(error.mean()), float(error.max())
