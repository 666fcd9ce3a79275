"""Everything that is measured of one prediction: one row of cases.csv."""

import logging
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from pinnochio.errors import InputError
from pinnochio.geometry.closest_points import Closest, signed_distances
from pinnochio.geometry.triangles import vertex_areas
from pinnochio.mechanics.elements.tetrahedra import Elements, lumped
from pinnochio.mechanics.settings import FemSettings
from pinnochio.metrics.case_columns import CASES
from pinnochio.metrics.chamfer import surface_metrics
from pinnochio.metrics.judged import Judged
from pinnochio.metrics.region_errors import landmark_points, region_errors
from pinnochio.metrics.validity import boundary_metrics, equilibrium_of, rest_elements, volume_metrics
from pinnochio.metrics.volume import mean_and_p95
from pinnochio.model.patient import FREE, NO_INTERFACE, PatientModel
from pinnochio.model.predictions import Prediction
from pinnochio.model.regions import NECK
from pinnochio.model.truth import TrueMotion
from pinnochio.plans.plan import Plan

# Columns that a prediction brings along.
COPIED = ("reason", "device", "seconds", "setup_seconds", "threads", "converged", "repaired", "damping")
# Measured of a learned method's own field too.
RAW = ("min_jacobian", "inverted", "eqres_paper", "eqres_rel")


@dataclass(frozen=True, eq=False)
class CaseJudge:
    """Measures predictions of one patient; what belongs to the patient is made once, when it is first needed.

    target: points and faces of the registered post-operative skin, and judged: where it is judged; it and the truth may
    be absent, and their columns are then empty. labels: what the caller knows, as the fold. fem: that of the residual.
    """

    patient: PatientModel
    fem: FemSettings
    seed: int
    target: tuple[np.ndarray, np.ndarray] | None = None
    judged: Judged | None = None
    truth: TrueMotion | None = None
    labels: dict = field(default_factory=dict)

    @cached_property
    def elements(self) -> Elements:
        return rest_elements(self.patient, self.fem)

    @cached_property
    def before(self) -> Closest:
        """The judged samples of the skin before surgery."""
        return self.judged.before(self.patient)

    @cached_property
    def landmarks(self) -> dict[str, int]:
        """Skin point nearest to each landmark, none where the face cannot be read."""
        try:
            return landmark_points(self.patient)
        except InputError as error:
            logging.info("no landmarks (%s)", error)
            return {}

    def row(self, plan: Plan, prediction: Prediction) -> dict:
        """One row of cases.csv.

        A prediction of the skin alone has none of the columns of the volume. One that is not finite gives a row without
        metrics, marked as not converged. Regions and landmarks stay empty where the face cannot be read.
        """
        patient, u, moved = self.patient, prediction.displacement, prediction.moved_skin(self.patient)
        row = dict.fromkeys((column.name for column in CASES if column.optional), np.nan)
        row |= {key: getattr(prediction, key) for key in COPIED} | {"case": plan.case, "seed": self.seed}
        row |= {"nodes": len(patient.points), "muscle": patient.muscle} | self.labels
        if not np.isfinite(moved if u is None else u).all():
            return row | {"converged": False, "reason": f"the field is not finite ({prediction.reason})"}
        if u is not None:
            row |= self._of_volume(u, prediction.forces) | boundary_metrics(patient, plan, u)
        if prediction.raw is not None:
            row |= {f"raw_{name}": value for name, value in self._of_volume(prediction.raw).items() if name in RAW}
        if prediction.boundary is not None:
            contact = (patient.node_type != FREE) & (patient.interface_kind != NO_INTERFACE)
            row["interface_error"] = np.linalg.norm(u - prediction.boundary, axis=1)[contact].mean()
        if self.target is not None:
            row |= self._against_scan(moved)
        if self.truth is not None:
            if u is not None:
                errors = np.linalg.norm(u - self.truth.nodes, axis=1)
                volumes = lumped(patient.cells, self.elements.volumes, len(patient.points))
                row |= mean_and_p95("volume_error", errors, volumes)
            errors = np.linalg.norm(moved - patient.skin_points - self.truth.skin, axis=1)
            row |= mean_and_p95("skin_error", errors, vertex_areas(patient.skin_points, patient.skin_faces))
            row |= {f"landmark_{name}": float(errors[point]) for name, point in self.landmarks.items()}
        return row

    def _of_volume(self, displacement, forces=None) -> dict:
        patient, elements = self.patient, self.elements
        metrics = volume_metrics(patient.points, patient.cells, patient.tissue, displacement)
        return metrics | equilibrium_of(patient, displacement, self.fem, forces, elements)

    def _against_scan(self, moved) -> dict:
        judged, faces, face = self.judged, self.patient.skin_faces, len(self.judged.target)
        inside = signed_distances(np.vstack([judged.target, judged.neck]), moved, faces)
        surfaces = self.before.carried(moved), *self.target, judged.target, np.abs(inside[:face])
        row = {"target_samples": face, "skin_samples": len(judged.skin)} | surface_metrics(moved, faces, *surfaces)
        return row | region_errors(np.append(judged.target_region, np.full(len(judged.neck), NECK)), -inside)
