"""The simulated outcome of a virtual patient's surgery: the displaced tissue, by mechanics that no method uses."""

import logging
import os
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import h5py
import numpy as np

from pinnochio.files import replacing
from pinnochio.importing.segmentation import Segmentation, read_segmentation
from pinnochio.mechanics.elements import VOLUMETRIC, jacobians
from pinnochio.mechanics.settings import FemSettings
from pinnochio.mechanics.simulation import simulate
from pinnochio.meshing.interfaces import label_interfaces
from pinnochio.meshing.lattice import tetrahedralize
from pinnochio.model.patient import PatientModel
from pinnochio.model.surfaces import bone_surface, skin_surface
from pinnochio.plans.plan import Plan
from pinnochio.plans.sampling import execution_error
from pinnochio.seeds import generator
from pinnochio.virtual.aftermath import expression, lip_change, looseness, read_landmarks, swelling
from pinnochio.virtual.scan import Scan, scan

LOG = logging.getLogger(__name__)
ATTEMPTS = 4  # an executed plan that tissue cannot follow is drawn again
PATIENCE = 1800.0  # s; far above what a solve takes: the truth must not depend on how busy the machine is


@dataclass(frozen=True)
class Operation:
    """What is operated on and how it would be computed nominally.

    head: the segmentation; landmarks name -> (3,) mm; mesh, interfaces: sections of the configuration; fem: the
    methods' settings; seed: base seed, from which each effect draws its own.
    """

    case: str
    head: Segmentation
    segments: tuple[str, ...]
    landmarks: Mapping[str, np.ndarray]
    plan: Plan
    mesh: Mapping[str, float]
    interfaces: Mapping[str, float]
    fem: FemSettings
    seed: int

    def draws(self, effect: str) -> np.random.Generator:
        """The effect's own generator: switching one effect leaves the draws of the others as they are."""
        return generator(self.seed, f"virtual_outcome/{effect}", self.case)

    @classmethod
    def read(cls, case: str, inputs: Mapping[str, str], labels: Mapping[str, int], segments, *settings) -> "Operation":
        """From the files segmentation, plan and landmarks; settings: mesh, interfaces, fem, seed."""
        head = read_segmentation(inputs["segmentation"], case, labels, segments)
        landmarks = read_landmarks(inputs["landmarks"])
        return cls(case, head, tuple(segments), landmarks, Plan.read(inputs["plan"], case), *settings)


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


def meshed(operation: Operation, reality: Mapping[str, Any]) -> PatientModel:
    """The model on which the outcome is computed; with nominal effects it is the methods' own."""
    head, thresholds = operation.head, dict(operation.interfaces)
    thresholds["sliding_band"] *= reality["sliding_band_factor"]
    nodes, shift = operation.mesh["nodes"], np.zeros(3)
    if reality["nodes"] is not None:
        nodes, shift = reality["nodes"], operation.draws("nodes").uniform(0, 3, 3)
    mesh = tetrahedralize(
        head.labels,
        head.spacing,
        head.origin,
        nodes,
        minimum_dihedral=operation.mesh["minimum_dihedral"],
        shift=shift,
    )
    return label_interfaces(
        mesh,
        head.labels,
        head.spacing,
        head.origin,
        operation.segments,
        bone_surface(head.labels, head.spacing, head.origin, operation.segments, operation.mesh["bone_edge"]),
        skin_surface(head.labels, head.spacing, head.origin),
        **thresholds,
    )


def operate(operation: Operation, reality: Mapping[str, Any], patient: PatientModel | None = None) -> Outcome:
    """Carry out the plan with the effects of `reality` (as :func:`pinnochio.virtual.ground_truth.resolve` gives them).

    patient: the model of :func:`meshed` where the caller has it already. RuntimeError if the mechanics finds no
    solution for a few draws of the executed plan.
    """
    patient = patient or meshed(operation, reality)
    draws = operation.draws("stiffness_spread")
    moduli = {
        tissue: modulus * float(np.exp(reality["stiffness_spread"] * draws.normal()))
        for tissue, modulus in sorted(operation.fem.youngs_modulus.items())
    }
    fem = operation.fem
    own = replace(
        fem,
        youngs_modulus=moduli,
        poisson=reality["poisson"] or fem.poisson,
        stiffening=reality["stiffening"],
        volumetric=VOLUMETRIC[0] if reality["nodes"] else fem.volumetric,
        time_limit=PATIENCE,
    )
    draws = operation.draws("execution_error")
    for _ in range(ATTEMPTS):
        executed = operation.plan
        if reality["execution_error"]:
            executed = execution_error(operation.plan, draws, reality["execution_error"])
        result = simulate(patient, executed, "mucosa", own)
        LOG.info("%s; moduli %s kPa; %.1f s", result.reason, moduli, result.seconds)
        if result.converged:
            break
    else:
        raise RuntimeError(f"case {operation.case!r}: the simulated outcome did not converge: {result.reason}")
    change = np.zeros_like(patient.points)
    if reality["lip_change"]:
        change += reality["lip_change"] * lip_change(patient.points, operation.landmarks)
    if reality["swelling"]:
        skin = patient.skin_points, patient.skin_faces
        rng = operation.draws("swelling")
        change += swelling(patient.points, skin, operation.landmarks, reality["swelling"], rng)
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


def photograph(operation: Operation, outcome: Outcome, reality: Mapping[str, Any]) -> Scan:
    """Scan of the outcome's skin with the effects of `reality`."""
    skin = outcome.patient.moved_skin(outcome.displacement)
    if reality["expression"]:
        here = outcome.patient.skin_points
        skin = skin + expression(here, operation.landmarks, reality["expression"], operation.draws("expression"))
    own = {name: reality[name] for name in ("noise", "holes", "coverage", "frame")}
    return scan(skin, outcome.patient.skin_faces, operation.draws("scan"), **own)
