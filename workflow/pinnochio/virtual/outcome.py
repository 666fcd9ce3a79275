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
from pinnochio.mechanics.boundary.conditions import BoundaryConditions
from pinnochio.mechanics.boundary.loads import Loads
from pinnochio.mechanics.elements.materials import neo_hookean
from pinnochio.mechanics.elements.tetrahedra import jacobians
from pinnochio.mechanics.settings import FemSettings
from pinnochio.mechanics.simulation import Simulator
from pinnochio.mechanics.solvers.inversion_repair import repair_inversions
from pinnochio.mechanics.solvers.linear_elasticity import ElasticSolver
from pinnochio.meshing.interfaces import label_interfaces
from pinnochio.meshing.tetrahedralize import tetrahedralize
from pinnochio.model.labels import MUSCLE, SUPERFICIAL
from pinnochio.model.patient import FREE, PatientModel
from pinnochio.model.surfaces import BoneSurface, bone_surface, skin_surface
from pinnochio.plans.plan import Plan
from pinnochio.plans.sampling import execution_error
from pinnochio.seeds import generator
from pinnochio.virtual.aftermath import (
    DECIDED,
    OPEN,
    UNSOURCED,
    Circumstances,
    Site,
    expression,
    lip_gap,
    read_landmarks,
)
from pinnochio.virtual.covariates import Covariates, thickness_scores
from pinnochio.virtual.face_scan import Scan, scan
from pinnochio.virtual.ground_truth import Dials, OutcomeSettings
from pinnochio.virtual.loading import loads

LOG = logging.getLogger(__name__)
TURN = 6.0, 12.0  # degrees by which the lattice of the outcome is turned [I]
LARGEST_CHANGE = 5.0  # mm that no change beyond mechanics exceeds [I]
ATTEMPTS = 4  # an executed plan that tissue cannot follow is drawn again
DRAINED = 0.3  # Poisson's ratio of tissue that swells, shrinks and settles: fluid comes and goes [I]


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
        return skin_surface(*self.head.label_map)

    @cached_property
    def bone(self) -> BoneSurface:
        """The head's bone before surgery, as the methods' import makes it."""
        return bone_surface(*self.head.label_map, self.segments, self.settings.mesh["bone_edge"])

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
        by = {"case": self.case, "file": "scan", "limit": np.inf, "bone": self.bone}
        registration = register(seen.points, seen.faces, *self.skin, plane, **by)
        return registration.motion.apply(seen.points), seen.faces

    def circumstances(self, executed: Plan) -> Circumstances:
        """What decides the changes of the face, once the plan is carried out so."""
        gap = lip_gap(self.head.labels, self.head.spacing, self.head.origin, self.landmarks)
        thickness = thickness_scores(self.anatomy["thickness"])
        return Circumstances.of(executed, self.landmarks, thickness, gap, self.covariates)


@dataclass(frozen=True)
class Outcome:
    """patient: the truth's own model; displacement (n, 3) mm of its nodes; executed: the plan as carried out.

    expected (n, 3) mm: the displacement of a patient with the same motion of the bones of whom nothing is random: what
    plan, anatomy and covariates decide.
    """

    patient: PatientModel
    displacement: np.ndarray
    executed: Plan
    expected: np.ndarray

    def write(self, path: str | os.PathLike) -> None:
        """Write as HDF5: points, cells, displacement, expected; attribute `executed`, the plan as JSON."""
        # Without the seal of other files: the frozen checksums of a cohort are those of these bytes.
        fields = {"displacement": self.displacement, "expected": self.expected}
        arrays = {"points": self.patient.points, "cells": self.patient.cells} | fields
        with replacing(path) as temporary, h5py.File(temporary, "w", track_order=True) as file:
            for name, values in arrays.items():
                file.create_dataset(name, data=values, compression="gzip", track_times=False)
            file.attrs["executed"] = self.executed.to_json()


@dataclass(frozen=True)
class Changes:
    """Displacements (n, 3) mm beyond mechanics: decided ones of published and of unstated size, and open ones."""

    sourced: np.ndarray
    unsourced: np.ndarray
    open: np.ndarray

    def decided(self, dials: Dials) -> np.ndarray:
        """What circumstances decide; published sizes are never stretched."""
        return min(dials.decided, 1.0) * self.sourced + dials.decided * self.unsourced

    def whole(self, dials: Dials) -> np.ndarray:
        """All of it."""
        return self.decided(dials) + dials.open * self.open


def meshed(operation: Operation, effects: Mapping[str, Any]) -> PatientModel:
    """The model on which the outcome is computed; with nominal effects and equal settings it is the methods' own."""
    place, settings = operation.head.label_map, operation.settings
    thresholds = dict(settings.interfaces)
    thresholds["sliding_band"] *= effects["sliding_band_factor"]
    nodes, shift, turn = settings.mesh["nodes"], np.zeros(3), 0.0
    if effects["nodes"] is not None:
        draws = operation.draws("nodes")
        nodes, shift, turn = effects["nodes"], draws.uniform(0, 3, 3), draws.choice([-1, 1]) * draws.uniform(*TURN)
    return label_interfaces(
        tetrahedralize(*place, nodes, minimum_dihedral=settings.mesh["minimum_dihedral"], shift=shift, turn=turn),
        *place,
        operation.segments,
        operation.bone,
        operation.skin,
        **thresholds,
    )


def moved(operation: Operation, effects: Mapping[str, Any], patient: PatientModel) -> Outcome:
    """What mechanics alone makes of the plan with these effects. RuntimeError as :func:`operate`."""
    draws = operation.draws("execution_error")
    settings, outer = _tissue(operation, effects, patient, random=True)
    with Simulator(patient, settings, loads=outer, everywhere=True) as simulator:
        for _ in range(ATTEMPTS):
            executed = operation.plan
            if effects["execution_error"]:
                executed = execution_error(operation.plan, draws, effects["execution_error"])
            displacement, reason = _solved(operation, simulator, patient, executed)
            if displacement is not None:
                break
        else:
            raise RuntimeError(f"case {operation.case!r}: the simulated outcome did not converge: {reason}")
        if not effects["stiffness_spread"] and not effects["pre_stress"]:
            return Outcome(patient, displacement, executed, displacement)
        mean = simulator.of(*_tissue(operation, effects, patient, random=False))
        expected, reason = _solved(operation, mean, patient, executed, displacement)
    if expected is None:
        raise RuntimeError(f"case {operation.case!r}: the expected outcome did not converge: {reason}")
    return Outcome(patient, displacement, executed, expected)


def _tissue(
    operation: Operation, effects: Mapping[str, Any], patient: PatientModel, random: bool
) -> tuple[FemSettings, Loads | None]:
    """Mechanics and loads of the patient's own tissue, or of the mean one."""
    fem, draws = operation.settings.fem, operation.draws("stiffness_spread")
    spread = effects["stiffness_spread"] if random else 0.0
    moduli = {
        tissue: modulus * float(np.exp(spread * draws.normal()))
        for tissue, modulus in sorted(fem.youngs_modulus.items())
    }
    LOG.info("moduli %s kPa", moduli)
    varied: FemSettings = replace(
        fem,
        youngs_modulus=moduli,
        poisson=effects["poisson"] or fem.poisson,
        stiffening=effects["stiffening"],
        yielding=effects["yielding"],
    )
    tension = operation.draws("pre_stress") if random else None
    return varied, loads(patient, operation.landmarks, effects["pre_stress"], tension)


def _solved(
    operation: Operation, simulator: Simulator, patient: PatientModel, executed: Plan, near: np.ndarray | None = None
) -> tuple[np.ndarray | None, str]:
    """Displacement (n, 3) mm under a plan, None where tissue cannot follow it, and why the solver stopped.

    near (n, 3) mm: a field to begin with.
    """
    (result,) = simulator.solve([executed], starts=None if near is None else near[None])
    LOG.info("%s; %.1f s", result.reason, result.seconds)
    if result.converged and result.min_jacobian > 0:
        return result.displacement, result.reason
    if result.converged:
        law, interface = operation.settings.fem.material(patient.tissue), patient.node_type != FREE
        field, repair = repair_inversions(patient.points, patient.cells, law, result.displacement, interface)
        LOG.info("%s", repair)
        if repair.damping == 1:
            return field, result.reason
    return None, result.reason


def change(operation: Operation, effects: Mapping[str, Any], outcome: Outcome) -> Changes:
    """What these effects change of the tissue beyond the mechanics, at dials of one."""
    patient = outcome.patient
    nodes = np.unique(patient.skin_nodes)
    site = Site(patient.points[nodes], (patient.skin_points, patient.skin_faces), operation.landmarks)
    circumstances = operation.circumstances(outcome.executed)
    total = {kind: np.zeros((len(nodes), 3)) for kind in ("sourced", "unsourced", "open")}
    for name, decide in DECIDED.items():
        if effects[name]:
            kind = "unsourced" if name in UNSOURCED else "sourced"
            total[kind] += effects[name] * site.field(decide(circumstances))
    for name, drawn in OPEN.items():
        if effects[name]:
            field = drawn(site, outcome.displacement[nodes], circumstances, operation.draws(name))
            total["open"] += effects[name] * field
    return Changes(*carried_inward(patient, nodes, np.stack(list(total.values()))))


def carried_inward(patient: PatientModel, nodes: np.ndarray, fields: np.ndarray) -> np.ndarray:
    """Displacements (k, n, 3) mm of all tissue that follows skin nodes (s,) displaced by fields (k, s, 3) mm, while
    what lies on bone rests: linear elasticity of drained tissue."""
    held = np.union1d(np.flatnonzero(patient.node_type != FREE), nodes)
    motions = np.zeros((len(fields), *patient.points.shape))
    motions[:, nodes] = fields
    motions[:, patient.node_type != FREE] = 0
    material = neo_hookean(patient.tissue, {SUPERFICIAL: 1.0, MUSCLE: 1.0}, DRAINED)
    solver = ElasticSolver(patient.points, patient.cells, material, BoundaryConditions(held, np.zeros((len(held), 3))))
    carried = solver.spread(motions)
    solver.close()
    return carried


def changed(patient: PatientModel, displacement: np.ndarray, field: np.ndarray) -> np.ndarray:
    """A displacement (n, 3) mm with a further one, as far as the elements take it; large ones level off."""
    size = np.linalg.norm(field, axis=1, keepdims=True) / LARGEST_CHANGE
    field = field * np.tanh(size) / np.maximum(size, 1e-9)
    return displacement + admissible(patient.points, patient.cells, displacement, field)


def operate(operation: Operation, effects: Mapping[str, Any]) -> Outcome:
    """Carry out the plan with these effects (as :func:`pinnochio.virtual.ground_truth.resolve` gives them).

    RuntimeError if the mechanics finds no solution for a few draws of the executed plan.
    """
    outcome = moved(operation, effects, meshed(operation, effects))
    if not any(effects[name] for name in (*DECIDED, *OPEN)):
        return outcome
    return after(outcome, change(operation, effects, outcome), operation.settings.dials)


def after(outcome: Outcome, changes: Changes, dials: Dials) -> Outcome:
    """The outcome of mechanics with the changes at these dials."""
    return replace(
        outcome,
        displacement=changed(outcome.patient, outcome.displacement, changes.whole(dials)),
        expected=changed(outcome.patient, outcome.expected, changes.decided(dials)),
    )


def admissible(points, cells, displacement, change) -> np.ndarray:
    """The change (n, 3) mm of a displacement, halved around elements as often as it takes to leave each of them a
    fifth of its volume ratio: at the bone some are so flat that no field of this kind suits them."""
    change, floor = np.array(change), 0.2 * jacobians(points, cells, displacement)
    while (flat := jacobians(points, cells, displacement + change) < floor).any():
        change[np.unique(cells[flat])] *= 0.5
    return change


def shown(operation: Operation, outcome: Outcome, effects: Mapping[str, Any]) -> np.ndarray:
    """Points (s, 3) mm of the outer skin when it is scanned."""
    patient = outcome.patient
    skin = patient.moved_skin(outcome.displacement)
    if effects["expression"]:
        site = Site(patient.skin_points, (patient.skin_points, patient.skin_faces), operation.landmarks)
        skin = skin + effects["expression"] * expression(site, operation.draws("expression"))
    return skin


def photograph(operation: Operation, outcome: Outcome, effects: Mapping[str, Any]) -> Scan:
    """Scan of the outcome's skin with these effects."""
    settings = {name: effects[name] for name in ("noise", "holes", "coverage", "frame")}
    skin = shown(operation, outcome, effects)
    return scan(skin, outcome.patient.skin_faces, operation.draws("scan"), **settings)
