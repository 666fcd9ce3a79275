"""Measures on a patient of the study how well the motion is found that made a face."""

import logging
from collections.abc import Mapping
from contextlib import closing
from dataclasses import replace

import numpy as np

from pinnochio.columns import write_rows
from pinnochio.geometry.interpolation import interpolate
from pinnochio.geometry.rigid import RigidMotion
from pinnochio.logs import attach_log
from pinnochio.mechanics.settings import FemSettings
from pinnochio.model.bones import segment_points
from pinnochio.model.patient import PatientModel
from pinnochio.model.postop import PostopSkin
from pinnochio.model.truth import read_truth
from pinnochio.plans.plan import Plan
from studies.inverse.columns import LANDMARKS, OUTCOME, RECOVERED, SIMULATED
from studies.inverse.elastic_face import ElasticFace
from studies.inverse.freedom import OPERATIONS, freedoms
from studies.inverse.proposal import InverseSettings, propose
from studies.inverse.wish import Marks, PlaceWish, SurfaceWish, Wish

EXACT = 0.002  # mm: tolerance of a search for the motion that made a simulated face, which is exact


def measure_inverse(
    case: str,
    model: str,
    plan: str,
    achieved: str | None,
    postop: str | None,
    truth: str | None,
    fem: FemSettings,
    settings: Mapping,
    code: str,
    recovered: str,
) -> None:
    """Write the rows of RECOVERED: a simulated face, sought exactly and with the tolerance of the settings; the scan.

    achieved, postop: motion and scan after surgery; truth: of a virtual patient, whose landmarks are wished; None
    where there is none.
    """
    patient = PatientModel.read(model)
    chosen = InverseSettings.of(settings)
    # By the operation that moves most of what the patient's segments allow.
    free = max(freedoms(patient, OPERATIONS, settings["bounds"]).values(), key=lambda each: len(each.low))
    rows = []
    with closing(ElasticFace(patient, fem)) as face:
        planned = free.plan(case, free.nearest(Plan.read(plan, case)))
        solved = face.solve(planned)
        if not solved.converged:
            raise RuntimeError(f"case {case!r}: the solver stopped: {solved.reason}")
        surface = SurfaceWish.of("face", patient, patient.moved_skin(solved.displacement), patient.skin_faces)
        tasks = [(SIMULATED, [surface], planned, tolerance) for tolerance in (EXACT, chosen.tolerance)]
        if achieved and postop:
            reference = Plan.read(achieved, case)
            scan = SurfaceWish.of("face", patient, *PostopSkin.read(postop).surface)
            tasks.append((OUTCOME, [scan], reference, chosen.tolerance))
            if truth:
                tasks.append((LANDMARKS, landmarks_after(patient, truth, case), reference, chosen.tolerance))
        for task, wish, reference, tolerance in tasks:
            proposal, _ = propose(face, wish, free, case, replace(chosen, tolerance=tolerance))
            logging.info("%s at %g: %.3f mm", task, tolerance, proposal.misfit)
            row = {"case": case, "task": task, "tolerance": tolerance, "code": code}
            row |= {"misfit": proposal.misfit, "seconds": proposal.seconds}
            rows += [row | part for part in motion_errors(patient, proposal.plan, reference)]
    write_rows(rows, recovered, RECOVERED)


def landmarks_after(patient: PatientModel, truth: str, case: str) -> Wish:
    """The landmarks of the face wished to where the true motion takes them."""
    marks = Marks.of(patient)
    targets = marks.rest + interpolate(marks.rest, *read_truth(truth, case)[:3])
    return [
        PlaceWish(name, marks.chosen([name]), target, 1.0) for name, target in zip(marks.names, targets, strict=True)
    ]


def motion_errors(patient: PatientModel, plan: Plan, reference: Plan) -> list[dict]:
    """By segment: mean motion of the reference, and how far the plan's is from it (mm of the bone, degrees)."""
    rows = []
    for name, bone in segment_points(patient).items():
        true = reference.motion(name)
        error, degrees = apart(plan.motion(name), true, bone)
        moved = float(np.linalg.norm(true.displacement(bone), axis=1).mean())
        rows.append({"segment": name, "moved": moved, "error": error, "degrees": degrees})
    return rows


def apart(one: RigidMotion, other: RigidMotion, bone: np.ndarray) -> tuple[float, float]:
    """Mean distance (mm) of bone points (b, 3) under two motions, and the angle (degrees) between their rotations."""
    return float(np.linalg.norm(one.apply(bone) - other.apply(bone), axis=1).mean()), one.angle_from(other)


if __name__ == "__main__":
    attach_log(snakemake.log[0])
    measure_inverse(
        case=snakemake.wildcards.case,
        model=snakemake.input.model,
        plan=snakemake.input.plan,
        achieved=next(iter(snakemake.input.get("achieved", [])), None),
        postop=next(iter(snakemake.input.get("postop", [])), None),
        truth=next(iter(snakemake.input.get("truth", [])), None),
        fem=FemSettings(**snakemake.params.fem),
        settings=snakemake.params.settings,
        code=snakemake.params.code,
        recovered=snakemake.output.recovered,
    )
