"""The simulated outcome of a virtual patient's surgery: the displaced tissue, by mechanics that no method uses."""

import logging
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import h5py
import numpy as np

from pinnochio.files import replacing
from pinnochio.importing.registration import register, upper_face_plane
from pinnochio.importing.segmentation import Segmentation, read_segmentation
from pinnochio.json_text import read_stored_json
from pinnochio.mechanics.elements.tetrahedra import jacobians
from pinnochio.mechanics.simulation import Simulator
from pinnochio.mechanics.solvers.inversion_repair import repair_inversions
from pinnochio.meshing.interfaces import label_interfaces
from pinnochio.meshing.tetrahedralize import tetrahedralize
from pinnochio.model.patient import FREE, PatientModel
from pinnochio.model.surfaces import BoneSurface, bone_surface, skin_surface
from pinnochio.plans.plan import Plan
from pinnochio.plans.sampling import execution_error
from pinnochio.seeds import generator
from pinnochio.virtual.aftermath import CHANGES, Circumstances, Site, expression, lip_gap, looseness, read_landmarks
from pinnochio.virtual.covariates import Covariates, thickness_scores
from pinnochio.virtual.face_scan import Scan, scan
from pinnochio.virtual.ground_truth import OutcomeSettings
from pinnochio.virtual.loading import loads

LOG = logging.getLogger(__name__)
TURN = 6.0, 12.0  # degrees by which the lattice of the outcome is turned [I]
LARGEST_CHANGE = 5.0  # mm that no change beyond mechanics exceeds [I]
ATTEMPTS = 4  # an executed plan that tissue cannot follow is drawn again


@dataclass(frozen=True)
class Operation:
    """What is operated on, and the settings of the outcome.

    head: the segmentation; landmarks name -> (3,) mm; anatomy: as drawn and measured; seed: base seed, from which each
    effect draws its own.
    """

    case: str
    head: Segmentation
    segments: tuple[str, ...]
    landmarks: Mapping[str, np.ndarray]
    plan: Plan
    settings: OutcomeSettings
    seed: int
    covariates: Covariates
    anatomy: Mapping[str, Any]

    @cached_property
    def skin(self) -> tuple[np.ndarray, np.ndarray]:
        """Points (s, 3) mm and faces of the head's skin before surgery."""
        return skin_surface(self.head.labels, self.head.spacing, self.head.origin)

    @cached_property
    def bone(self) -> BoneSurface:
        """The head's bone before surgery, as the methods' import makes it."""
        head = self.head
        return bone_surface(head.labels, head.spacing, head.origin, self.segments, self.settings.mesh["bone_edge"])

    def draws(self, effect: str) -> np.random.Generator:
        """The effect's own generator: switching one effect leaves the draws of the others as they are."""
        return generator(self.seed, f"virtual_outcome/{effect}", self.case)

    @classmethod
    def read(
        cls,
        case: str,
        inputs: Mapping[str, str],
        labels: Mapping[str, int],
        segments: Sequence[str],
        outcome: Mapping[str, Any],
        seed: int,
    ) -> "Operation":
        """From the files segmentation, plan, landmarks, anatomy and covariates; outcome: section `virtual.outcome` of
        the configuration. segments: those that a case may have."""
        head = read_segmentation(inputs["segmentation"], case, labels, segments)
        return cls(
            case=case,
            head=head,
            segments=head.segments,
            landmarks=read_landmarks(inputs["landmarks"]),
            plan=Plan.read(inputs["plan"], case),
            settings=OutcomeSettings.of(outcome),
            seed=seed,
            covariates=Covariates.read(inputs["covariates"]),
            anatomy=read_stored_json(inputs["anatomy"]),
        )

    def registered(self, seen: Scan) -> tuple[np.ndarray, np.ndarray]:
        """Points (n, 3) mm and faces of a scan, registered to the head before surgery as the import does it."""
        plane = upper_face_plane(self.bone, self.segments, self.settings.interfaces["nasion_above_maxilla"])
        registration = register(seen.points, seen.faces, *self.skin, plane, case=self.case, file="scan", limit=np.inf)
        return registration.motion.apply(seen.points), seen.faces

    def circumstances(self, executed: Plan) -> Circumstances:
        """What decides the changes of the face, once the plan is carried out so."""
        gap = lip_gap(self.head.labels, self.head.spacing, self.head.origin, self.landmarks)
        thickness = thickness_scores(self.anatomy["thickness"])
        return Circumstances.of(executed, self.landmarks, thickness, gap, self.covariates)


@dataclass(frozen=True)
class Outcome:
    """patient: the truth's own model; displacement (n, 3) mm of its nodes; executed: the plan as carried out."""

    patient: PatientModel
    displacement: np.ndarray
    executed: Plan

    def write(self, path: str | os.PathLike) -> None:
        """Write as HDF5: points, cells, displacement; attribute `executed`, the plan as JSON."""
        # Without the seal of other files: the frozen checksums of a cohort are those of these bytes.
        arrays = {"points": self.patient.points, "cells": self.patient.cells, "displacement": self.displacement}
        with replacing(path) as temporary, h5py.File(temporary, "w", track_order=True) as file:
            for name, values in arrays.items():
                file.create_dataset(name, data=values, compression="gzip", track_times=False)
            file.attrs["executed"] = self.executed.to_json()


def meshed(operation: Operation, effects: Mapping[str, Any], by_lip: bool | None = None) -> PatientModel:
    """The model on which the outcome is computed; with nominal effects and equal settings it is the methods' own.

    by_lip as of :func:`label_interfaces`, by default as the cohorts were frozen: before skin was told apart by lip.
    """
    head, settings = operation.head, operation.settings
    thresholds = dict(settings.interfaces)
    thresholds["sliding_band"] *= effects["sliding_band_factor"]
    nodes, shift, turn = settings.mesh["nodes"], np.zeros(3), 0.0
    if effects["nodes"] is not None:
        draws = operation.draws("nodes")
        nodes, shift, turn = effects["nodes"], draws.uniform(0, 3, 3), draws.choice([-1, 1]) * draws.uniform(*TURN)
    place = head.labels, head.spacing, head.origin
    return label_interfaces(
        tetrahedralize(*place, nodes, minimum_dihedral=settings.mesh["minimum_dihedral"], shift=shift, turn=turn),
        *place,
        operation.segments,
        operation.bone,
        operation.skin,
        by_lip=effects["nodes"] is None if by_lip is None else by_lip,
        **thresholds,
    )


def moved(operation: Operation, effects: Mapping[str, Any], patient: PatientModel) -> Outcome:
    """What mechanics alone makes of the plan with these effects. RuntimeError as :func:`operate`."""
    fem = operation.settings.fem
    draws = operation.draws("stiffness_spread")
    moduli = {
        tissue: modulus * float(np.exp(effects["stiffness_spread"] * draws.normal()))
        for tissue, modulus in sorted(fem.youngs_modulus.items())
    }
    poisson = effects["poisson"] or fem.poisson
    varied = replace(
        fem,
        youngs_modulus=moduli,
        poisson=poisson,
        stiffening=effects["stiffening"],
        yielding=effects["yielding"],
    )
    outer = loads(
        patient,
        operation.landmarks,
        operation.covariates,
        effects["posture"],
        effects["pre_stress"],
        operation.draws("pre_stress"),
    )
    draws = operation.draws("execution_error")
    with Simulator(patient, varied, unilateral=bool(effects["contact"]), loads=outer) as simulator:
        for _ in range(ATTEMPTS):
            executed = operation.plan
            if effects["execution_error"]:
                executed = execution_error(operation.plan, draws, effects["execution_error"])
            (result,) = simulator.solve([executed])
            LOG.info("%s; moduli %s kPa; %.1f s", result.reason, moduli, result.seconds)
            if result.converged and result.min_jacobian > 0:
                return Outcome(patient, result.displacement, executed)
            if result.converged:
                law, interface = fem.material(patient.tissue), patient.node_type != FREE
                field, repair = repair_inversions(patient.points, patient.cells, law, result.displacement, interface)
                LOG.info("%s", repair)
                if repair.damping == 1:
                    return Outcome(patient, field, executed)
    raise RuntimeError(f"case {operation.case!r}: the simulated outcome did not converge: {result.reason}")


def change(operation: Operation, effects: Mapping[str, Any], outcome: Outcome) -> np.ndarray:
    """What these effects change of the tissue (n, 3) mm beyond the mechanics, at a scale of one."""
    patient = outcome.patient
    site = Site(patient.points, (patient.skin_points, patient.skin_faces), operation.landmarks)
    circumstances = operation.circumstances(outcome.executed)
    total = np.zeros_like(patient.points)
    for name, field in CHANGES.items():
        if effects[name]:
            decided_by = outcome.displacement if name == "gain" else circumstances
            total += effects[name] * field(site, decided_by, operation.draws(name))
    return total * looseness(patient.points, patient.bone_points)[:, None]


def changed(outcome: Outcome, field: np.ndarray) -> Outcome:
    """The outcome with a further displacement (n, 3) mm, as far as its elements take it; large ones level off."""
    patient, moved_so_far = outcome.patient, outcome.displacement
    size = np.linalg.norm(field, axis=1, keepdims=True) / LARGEST_CHANGE
    field = field * np.tanh(size) / np.maximum(size, 1e-9)
    field = admissible(patient.points, patient.cells, moved_so_far, field)
    return replace(outcome, displacement=moved_so_far + field)


def operate(operation: Operation, effects: Mapping[str, Any], patient: PatientModel | None = None) -> Outcome:
    """Carry out the plan with these effects (as :func:`pinnochio.virtual.ground_truth.resolve` gives them).

    patient: the model of :func:`meshed` where the caller has it already. RuntimeError if the mechanics finds no
    solution for a few draws of the executed plan.
    """
    outcome = moved(operation, effects, patient or meshed(operation, effects))
    if not any(effects[name] for name in CHANGES):
        return outcome
    return changed(outcome, operation.settings.scale * change(operation, effects, outcome))


def admissible(points, cells, displacement, change) -> np.ndarray:
    """The change (n, 3) mm of a displacement, halved around elements as often as it takes to leave each of them a
    fifth of its volume ratio: at the bone some are so flat that no field of this kind suits them."""
    change, floor = np.array(change), 0.2 * jacobians(points, cells, displacement)
    while (flat := jacobians(points, cells, displacement + change) < floor).any():
        change[np.unique(cells[flat])] *= 0.5
    return change


def shown(operation: Operation, outcome: Outcome, effects: Mapping[str, Any], scale: float | None = None) -> np.ndarray:
    """Points (s, 3) mm of the outer skin when it is scanned; scale: of the expression, if not that of the settings."""
    patient = outcome.patient
    skin = patient.moved_skin(outcome.displacement)
    if effects["expression"]:
        site = Site(patient.skin_points, (patient.skin_points, patient.skin_faces), operation.landmarks)
        amount = effects["expression"] * (operation.settings.scale if scale is None else scale)
        skin = skin + amount * expression(site, operation.draws("expression"))
    return skin


def photograph(operation: Operation, outcome: Outcome, effects: Mapping[str, Any], scale: float | None = None) -> Scan:
    """Scan of the outcome's skin with these effects; scale as in :func:`shown`."""
    settings = {name: effects[name] for name in ("noise", "holes", "coverage", "frame")}
    skin = shown(operation, outcome, effects, scale)
    return scan(skin, outcome.patient.skin_faces, operation.draws("scan"), **settings)
