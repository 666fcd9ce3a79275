"""One setting on one patient: seconds, and how far the field is from the reference."""

import os
from dataclasses import asdict, dataclass, replace

import numpy as np

from pinnochio.geometry.interpolation import interpolate
from pinnochio.mechanics.elements.tetrahedra import node_volumes
from pinnochio.mechanics.settings import FemSettings
from pinnochio.mechanics.simulation import Simulator
from pinnochio.methods.elastic import linear_field
from pinnochio.methods.pinnochio.predictor import GraphPredictor
from pinnochio.methods.protocol import Planned
from pinnochio.metrics.validity import equilibrium_of, volume_metrics
from pinnochio.model.patient import PatientModel
from pinnochio.model.predictions import Prediction
from pinnochio.plans.plan import Plan
from pinnochio.timing import repeated
from studies.tradeoff.settings import Setting

PATIENCE = 5.0  # s; a solve that takes longer is not repeated


@dataclass(frozen=True)
class Reference:
    """The finite-element solution that the others are judged by: patient and displacement (n, 3) mm."""

    patient: PatientModel
    displacement: np.ndarray

    @staticmethod
    def of(patient: PatientModel, prediction: Prediction) -> "Reference | None":
        """The prediction on the patient's mesh; None where the solver did not converge."""
        return Reference(patient, prediction.displacement) if prediction.converged else None

    def face_errors(self, patient: PatientModel, moved: np.ndarray) -> np.ndarray:
        """Distance (k,) mm of the judged points of the patient's skin, moved (s, 3) mm, from where they are here."""
        judged = patient.judged_points
        here = self.patient.moved_skin(self.displacement) - self.patient.skin_points
        local = self.patient.skin_at(patient.skin_points[judged])
        there = (moved - patient.skin_points)[judged]
        return np.linalg.norm(there - here[local], axis=1)[local >= 0]

    def volume_error(self, patient: PatientModel, displacement: np.ndarray) -> float:
        """Mean distance in mm of a displacement (n, 3) mm of the patient from the one here, over the tissue."""
        local = self.patient
        there = interpolate(patient.points, local.points, local.cells, self.displacement)
        errors = np.linalg.norm(displacement - there, axis=1)
        return float(np.average(errors, weights=node_volumes(patient.points, patient.cells)))


def judge(
    setting: Setting,
    case: str,
    patient: PatientModel,
    prediction: Prediction,
    reference: Reference | None,
    fem: FemSettings,
) -> dict:
    """One row of :data:`~studies.tradeoff.cases.TRADEOFF_CASES`; a field that is not finite has no metrics.

    fem: of the study, whose residual is reported. Without a reference there is no distance from it.
    """
    row = {"case": case, "method": setting.method, "parameter": setting.parameter, "value": setting.value}
    row |= {"nodes": len(patient.points), "converged": prediction.converged}
    row |= {"seconds": prediction.seconds, "setup_seconds": prediction.setup_seconds, "threads": prediction.threads}
    u, moved = prediction.displacement, prediction.moved_skin(patient)
    row |= dict.fromkeys(("face_error", "face_error_max"), np.nan)
    row |= dict.fromkeys(("volume_error", "eqres_rel", "min_jacobian", "inverted"), np.nan)
    if not np.isfinite(moved).all():
        return row | {"converged": False}
    if reference is not None:
        errors = reference.face_errors(patient, moved)
        row |= {"face_error": errors.mean(), "face_error_max": errors.max()}
    if u is not None:
        if reference is not None:
            row["volume_error"] = reference.volume_error(patient, u)
        volume = volume_metrics(patient.points, patient.cells, patient.tissue, u)
        row |= {name: volume[name] for name in ("min_jacobian", "inverted")}
        row["eqres_rel"] = equilibrium_of(patient, u, fem, prediction.forces)["eqres_rel"]
    return row


def predict_fem(setting: Setting, patient: PatientModel, plan: Plan, fem: FemSettings, threads: int) -> Prediction:
    """The plan by finite elements with the setting's parameter; warm, median of repeats unless a solve takes long."""
    local = replace(fem, **setting.fem)
    if not setting.contact:
        return Prediction(*linear_field(patient, plan, local), threads)
    with Simulator(patient, local, setting.contact) as simulator:
        solved, seconds = repeated(lambda: simulator.solve([plan])[0], PATIENCE)
        setup = simulator.preparation
    return Prediction(solved.displacement, seconds, setup, threads, converged=solved.converged, reason=solved.reason)


def predict_network(
    setting: Setting, file: str | os.PathLike, planned: Planned, fem: FemSettings, device: str, threads: int
) -> Prediction:
    """The plan by the trained network in `file`, repaired and corrected, timed as the study times it."""
    settings = {"fem": asdict(fem), "newton_corrections": setting.corrections}
    return GraphPredictor(settings, file, device, threads)(planned)
