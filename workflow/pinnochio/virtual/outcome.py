"""The simulated outcome of a virtual patient's surgery: the displaced tissue, by mechanics that no method uses."""

import logging
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import h5py
import numpy as np

from pinnochio.files import replacing
from pinnochio.importing.segmentation import Segmentation, read_segmentation
from pinnochio.mechanics.elements import jacobians
from pinnochio.mechanics.simulation import simulate
from pinnochio.meshing.interfaces import label_interfaces
from pinnochio.meshing.lattice import tetrahedralize
from pinnochio.model.patient import PatientModel
from pinnochio.model.surfaces import bone_surface, skin_surface
from pinnochio.plans.plan import Plan
from pinnochio.plans.sampling import execution_error
from pinnochio.seeds import generator
from pinnochio.virtual.aftermath import expression, lip_change, looseness, read_landmarks, swelling
from pinnochio.virtual.ground_truth import OutcomeSettings
from pinnochio.virtual.scan import Scan, scan

LOG = logging.getLogger(__name__)
ATTEMPTS = 4  # an executed plan that tissue cannot follow is drawn again


@dataclass(frozen=True)
class Operation:
    """What is operated on, and the settings of the outcome.

    head: the segmentation; landmarks name -> (3,) mm; seed: base seed, from which each effect draws its own.
    """

    case: str
    head: Segmentation
    segments: tuple[str, ...]
    landmarks: Mapping[str, np.ndarray]
    plan: Plan
    settings: OutcomeSettings
    seed: int

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
        """From the files segmentation, plan and landmarks; outcome: section `virtual.outcome` of the configuration."""
        head = read_segmentation(inputs["segmentation"], case, labels, segments)
        return cls(
            case=case,
            head=head,
            segments=head.segments,
            landmarks=read_landmarks(inputs["landmarks"]),
            plan=Plan.read(inputs["plan"], case),
            settings=OutcomeSettings.of(outcome),
            seed=seed,
        )


@dataclass(frozen=True)
class Outcome:
    """patient: the truth's own model; displacement (n, 3) mm of its nodes; executed: the plan as carried out."""

    patient: PatientModel
    displacement: np.ndarray
    executed: Plan

    def write(self, path: str | os.PathLike) -> None:
        """Write as HDF5: points, cells, displacement; attribute `executed`, the plan as JSON."""
        own = {"points": self.patient.points, "cells": self.patient.cells, "displacement": self.displacement}
        with replacing(path) as temporary, h5py.File(temporary, "w", track_order=True) as file:
            for name, values in own.items():
                file.create_dataset(name, data=values, compression="gzip", track_times=False)
            file.attrs["executed"] = self.executed.to_json()


def meshed(operation: Operation, effects: Mapping[str, Any]) -> PatientModel:
    """The model on which the outcome is computed; with nominal effects and equal settings it is the methods' own."""
    head, settings = operation.head, operation.settings
    thresholds = dict(settings.interfaces)
    thresholds["sliding_band"] *= effects["sliding_band_factor"]
    nodes, shift = settings.mesh["nodes"], np.zeros(3)
    if effects["nodes"] is not None:
        nodes, shift = effects["nodes"], operation.draws("nodes").uniform(0, 3, 3)
    place = head.labels, head.spacing, head.origin
    return label_interfaces(
        tetrahedralize(*place, nodes, minimum_dihedral=settings.mesh["minimum_dihedral"], shift=shift),
        *place,
        operation.segments,
        bone_surface(head.labels, head.spacing, head.origin, operation.segments, settings.mesh["bone_edge"]),
        skin_surface(head.labels, head.spacing, head.origin),
        **thresholds,
    )


def operate(operation: Operation, effects: Mapping[str, Any], patient: PatientModel | None = None) -> Outcome:
    """Carry out the plan with these effects (as :func:`pinnochio.virtual.ground_truth.resolve` gives them).

    patient: the model of :func:`meshed` where the caller has it already. RuntimeError if the mechanics finds no
    solution for a few draws of the executed plan.
    """
    patient, fem = patient or meshed(operation, effects), operation.settings.fem
    draws = operation.draws("stiffness_spread")
    moduli = {
        tissue: modulus * float(np.exp(effects["stiffness_spread"] * draws.normal()))
        for tissue, modulus in sorted(fem.youngs_modulus.items())
    }
    poisson = effects["poisson"] or fem.poisson
    own = replace(fem, youngs_modulus=moduli, poisson=poisson, stiffening=effects["stiffening"])
    draws = operation.draws("execution_error")
    for _ in range(ATTEMPTS):
        executed = operation.plan
        if effects["execution_error"]:
            executed = execution_error(operation.plan, draws, effects["execution_error"])
        result = simulate(patient, executed, "mucosa", own)
        LOG.info("%s; moduli %s kPa; %.1f s", result.reason, moduli, result.seconds)
        if result.converged:
            break
    else:
        raise RuntimeError(f"case {operation.case!r}: the simulated outcome did not converge: {result.reason}")
    change = np.zeros_like(patient.points)
    if effects["lip_change"]:
        change += effects["lip_change"] * lip_change(patient.points, operation.landmarks)
    if effects["swelling"]:
        skin = patient.skin_points, patient.skin_faces
        rng = operation.draws("swelling")
        change += swelling(patient.points, skin, operation.landmarks, effects["swelling"], rng)
    if change.any():
        change *= looseness(patient.points, patient.bone_points)[:, None]
        change = admissible(patient.points, patient.cells, result.displacement, change)
    return Outcome(patient, result.displacement + change, executed)


def admissible(points, cells, displacement, change) -> np.ndarray:
    """The change (n, 3) mm of a displacement, halved around elements as often as it takes to leave each of them a
    fifth of its volume ratio: at the bone some are so flat that no field of this kind suits them."""
    change, floor = np.array(change), 0.2 * jacobians(points, cells, displacement)
    while (flat := jacobians(points, cells, displacement + change) < floor).any():
        change[np.unique(cells[flat])] *= 0.5
    return change


def photograph(operation: Operation, outcome: Outcome, effects: Mapping[str, Any]) -> Scan:
    """Scan of the outcome's skin with these effects."""
    skin = outcome.patient.moved_skin(outcome.displacement)
    if effects["expression"]:
        here = outcome.patient.skin_points
        skin = skin + expression(here, operation.landmarks, effects["expression"], operation.draws("expression"))
    own = {name: effects[name] for name in ("noise", "holes", "coverage", "frame")}
    return scan(skin, outcome.patient.skin_faces, operation.draws("scan"), **own)
