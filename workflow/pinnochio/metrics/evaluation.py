"""Everything that is measured of one prediction: one row of cases.csv."""

import logging

import numpy as np

from pinnochio.errors import InputError
from pinnochio.geometry.closest_points import signed_distances
from pinnochio.geometry.triangles import vertex_areas
from pinnochio.mechanics.elements.tetrahedra import node_volumes
from pinnochio.mechanics.settings import FemSettings
from pinnochio.metrics.case_columns import CASES
from pinnochio.metrics.chamfer import surface_metrics
from pinnochio.metrics.judged import Judged
from pinnochio.metrics.region_errors import landmark_errors, region_errors
from pinnochio.metrics.validity import boundary_metrics, equilibrium_of, volume_metrics
from pinnochio.metrics.volume import mean_and_p95
from pinnochio.model.patient import FREE, NO_INTERFACE, PatientModel
from pinnochio.model.predictions import Prediction
from pinnochio.model.regions import NECK
from pinnochio.model.truth import TrueMotion
from pinnochio.plans.plan import Plan

# Columns that a prediction brings along.
COPIED = ("device", "seconds", "setup_seconds", "threads", "converged")
COPIED += ("repaired", "damping")
# Measured of a learned method's own field too.
RAW = ("min_jacobian", "inverted", "eqres_paper", "eqres_rel")


def evaluate_case(
    patient: PatientModel,
    plan: Plan,
    prediction: Prediction,
    *,
    fem: FemSettings,
    seed: int,
    target: tuple[np.ndarray, np.ndarray] | None = None,
    judged: Judged | None = None,
    truth: TrueMotion | None = None,
    labels: dict | None = None,
) -> dict:
    """One row of cases.csv.

    target: points and faces of the registered post-operative skin, and judged: where it is judged; it and the truth may
    be absent, and their columns are then empty. labels: what the caller knows (fold, method, code,
    registration). fem: material and elements of the residual.
    A prediction of the skin alone has none of the columns of the volume. One that is not finite gives a row without
    metrics, marked as not converged. Regions and landmarks stay empty where the face cannot be read.
    """
    u, moved = prediction.displacement, prediction.moved_skin(patient)
    row = dict.fromkeys((column.name for column in CASES if column.optional), np.nan)
    row |= {"reason": prediction.reason, "case": plan.case, "seed": seed}
    row |= {key: getattr(prediction, key) for key in COPIED}
    row |= {"nodes": len(patient.points), "muscle": patient.muscle} | (labels or {})
    if not np.isfinite(moved if u is None else u).all():
        return row | {"converged": False, "reason": f"the field is not finite ({prediction.reason})"}
    if u is not None:
        row |= volume_metrics(patient.points, patient.cells, patient.tissue, u)
        row |= equilibrium_of(patient, u, fem, prediction.forces)
        row |= boundary_metrics(patient, plan, u)
    if prediction.raw is not None:
        raw = volume_metrics(patient.points, patient.cells, patient.tissue, prediction.raw)
        raw |= equilibrium_of(patient, prediction.raw, fem)
        row |= {f"raw_{name}": raw[name] for name in RAW}
    if prediction.boundary is not None:
        contact = (patient.node_type != FREE) & (patient.interface_kind != NO_INTERFACE)
        row["interface_error"] = np.linalg.norm(u - prediction.boundary, axis=1)[contact].mean()
    if target is not None:
        row |= {"target_samples": len(judged.target), "skin_samples": len(judged.skin)}
        skin, face = judged.carried(patient, moved), len(judged.target)
        inside = signed_distances(np.vstack([judged.target, judged.neck]), moved, patient.skin_faces)
        row |= surface_metrics(moved, patient.skin_faces, skin, *target, judged.target, np.abs(inside[:face]))
        row |= region_errors(np.append(judged.target_region, np.full(len(judged.neck), NECK)), -inside)
    if truth is not None:
        if u is not None:
            errors = np.linalg.norm(u - truth.nodes, axis=1)
            row |= mean_and_p95("volume_error", errors, node_volumes(patient.points, patient.cells))
        errors = np.linalg.norm(moved - patient.skin_points - truth.skin, axis=1)
        row |= mean_and_p95("skin_error", errors, vertex_areas(patient.skin_points, patient.skin_faces))
        try:
            row |= landmark_errors(patient, errors)
        except InputError as error:
            logging.info("%s: no landmarks (%s)", plan.case, error)
    return row
