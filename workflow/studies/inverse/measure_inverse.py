"""Measures on a patient of the study how well the motion is found that made a face."""

import logging
from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from pinnochio.columns import write_rows
from pinnochio.geometry.interpolation import interpolate
from pinnochio.logs import attach_log
from pinnochio.mechanics.settings import FemSettings
from pinnochio.model.patient import PatientModel
from pinnochio.model.postop import PostopSkin
from pinnochio.model.truth import read_truth
from pinnochio.plans.plan import Plan
from studies.inverse.alternatives import Answer
from studies.inverse.columns import FACES, MARKED, RECOVERED, SEEN
from studies.inverse.elastic_face import ElasticFace
from studies.inverse.freedom import QUANTITIES
from studies.inverse.measuring import (
    EXACT,
    LANDMARKS,
    OUTCOME,
    SIMULATED,
    as_vector,
    motion_rows,
    places_at,
    seen,
    sought,
    widest,
)
from studies.inverse.proposal import InverseSettings
from studies.inverse.wish import Marks, SurfaceWish, misfit


def measure_inverse(
    case: str,
    model: str,
    plan: str,
    achieved: str | None,
    postop: str | None,
    truth: str | None,
    fem: FemSettings,
    settings: Mapping,
    tolerances: Sequence[float],
    seed: int,
    code: str,
    out: Mapping[str, str],
) -> None:
    """Write what was found (RECOVERED), of which faces (FACES), at which landmarks (MARKED), and what a regression sees
    (SEEN).

    achieved, postop: motion and scan after surgery; truth: of a virtual patient, whose landmarks are wished; None
    where there is none. tolerances: that are tried, where the face is a real outcome. out: recovered, faces, marked,
    seen.
    """
    patient = PatientModel.read(model)
    chosen = InverseSettings.of(settings)
    operation, free = widest(patient, settings["bounds"])
    tried = sorted({chosen.tolerance, *tolerances})
    marks, face = Marks.of(patient), ElasticFace(patient, fem)
    recovered, faces, features, marked = [], [], [], []
    try:
        planned = free.plan(case, free.nearest(Plan.read(plan, case)))
        field = solved(face, planned)
        surface = SurfaceWish.of("face", patient, patient.moved_skin(field), patient.skin_faces)
        skin = patient.moved_skin(field) - patient.skin_points
        tasks = {SIMULATED: ([surface], planned, [EXACT, chosen.tolerance], skin)}
        if achieved and postop:
            reference, scan = Plan.read(achieved, case), PostopSkin.read(postop)
            wish = SurfaceWish.of("face", patient, *scan.surface)
            tasks[OUTCOME] = [wish], reference, tried, wish
            if truth:
                points, cells, displacement, _ = read_truth(truth, case)
                moved = interpolate(marks.rest, points, cells, displacement)
                skin = interpolate(patient.skin_points, points, cells, displacement)
                tasks[LANDMARKS] = places_at(marks, moved), reference, tried, skin
                forward = marks.moved(solved(face, reference)) - marks.rest - moved
        for task, (wish, reference, charged, shown) in tasks.items():
            values = enumerate(seen(patient, marks, shown))
            features += [{"case": case, "task": task, "feature": number, "value": value} for number, value in values]
            for tolerance in charged:
                answer = sought(face, wish, operation, free, chosen, tolerance, case)
                logging.info("%s at %g: %.3f mm", task, tolerance, answer.proposal.misfit)
                key = {"case": case, "task": task, "tolerance": tolerance}
                recovered += [key | row for row in recovered_rows(patient, answer, reference)]
                wished = misfit(wish, np.zeros_like(patient.points))
                faces.append(key | face_row(answer, operation, wished) | {"seed": seed, "code": code})
                if task == LANDMARKS and tolerance == chosen.tolerance:
                    errors = [item.error(answer.proposal.displacement) for item in wish]
                    marked = marked_rows(case, marks, moved, errors, forward)
    finally:
        face.close()
    write_rows(recovered, out["recovered"], RECOVERED)
    write_rows(faces, out["faces"], FACES)
    write_rows(features, out["seen"], SEEN)
    empty = {"case": case, "place": "-", "moved": np.nan, "error": np.nan, "forward_error": np.nan}
    write_rows(marked or [empty], out["marked"], MARKED)


def recovered_rows(patient: PatientModel, answer: Answer, reference: Plan) -> Iterator[dict]:
    """Rows of RECOVERED without their key: errors of each segment's motion, and its true motion."""
    for row in motion_rows(answer, reference):
        index = patient.segments.index(row["segment"])
        middle = patient.bone_points[patient.bone_segment == index].mean(axis=0)
        true = as_vector(reference.motion(row["segment"]), middle)
        yield row | {f"true_{name}": value for name, value in zip(QUANTITIES, true, strict=True)}


def face_row(answer: Answer, operation: str, wished: float) -> dict:
    """A row of FACES without its key; wished: misfit (mm) of the face at rest."""
    proposal = answer.proposal
    return {
        "operation": operation,
        "asked": wished,
        "misfit": proposal.misfit,
        "elastic_gap": proposal.gap,
        "untold": int(answer.combinations.hidden.sum()),
        "parameters": len(proposal.x),
        "bounded": len(proposal.at_bounds),
        "solved": proposal.solved,
        "corrections": proposal.corrections,
        "seconds_elastic": proposal.seconds_elastic,
        "seconds": proposal.seconds,
    }


def marked_rows(case: str, marks: Marks, moved: np.ndarray, errors: Sequence[float], forward: np.ndarray) -> list[dict]:
    """Rows of MARKED: how far each mark moved, its error in mm, and that of the true motion's own face."""
    return [
        {
            "case": case,
            "place": name,
            "moved": float(np.linalg.norm(moved[number])),
            "error": errors[number],
            "forward_error": float(np.linalg.norm(forward[number])),
        }
        for number, name in enumerate(marks.names)
    ]


def solved(face: ElasticFace, plan: Plan) -> np.ndarray:
    """Finite elements (n, 3) mm of a plan; RuntimeError where they do not converge."""
    result = face.solve(plan)
    if not result.converged:
        raise RuntimeError(f"case {plan.case!r}: the solver stopped: {result.reason}")
    return result.displacement


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
        tolerances=snakemake.params.settings["tolerances"],
        seed=snakemake.params.seed,
        code=snakemake.params.code,
        out=dict(snakemake.output.items()),
    )
