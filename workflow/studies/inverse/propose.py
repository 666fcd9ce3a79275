"""Makes plans that bring a patient's face to what is wished of it: one for each operation."""

from collections.abc import Mapping, Sequence
from contextlib import closing
from pathlib import Path

import numpy as np

from pinnochio.columns import write_rows
from pinnochio.logs import attach_log
from pinnochio.mechanics.settings import FemSettings
from pinnochio.model.bones import segment_points
from pinnochio.model.patient import PatientModel
from pinnochio.patients.certificate import measures, plain, verdict
from pinnochio.plans.plan import Plan
from pinnochio.plans.transforms import write_transforms
from pinnochio.statistics.intervals import Calibration
from studies.inverse.alternatives import Answer, answers, contradictions
from studies.inverse.combinations import quantities
from studies.inverse.elastic_face import ElasticFace
from studies.inverse.proposal import InverseSettings
from studies.inverse.reading import read_wish
from studies.inverse.wish import Wish, misfit, regions_of
from studies.inverse.wish_columns import COMBINATIONS, MOTIONS, PROPOSALS, REACHED
from studies.inverse.wish_page import write_wish_page


def propose_plans(
    case: str,
    model: str,
    wish: Sequence[str],
    markups: Sequence[str],
    occlusion: str | None,
    calibration: str | None,
    fem: FemSettings,
    settings: Mapping,
    code: str,
    out: Mapping[str, str],
) -> None:
    """Write proposals, what each reaches, its motions and what the wish cannot tell apart (CSV), plans, transforms and
    the page.

    wish, markups: files of the user's; occlusion: a plan whose relation of the jaws is kept; calibration: of the
    intervals of finite elements; settings: section `invert` of the configuration; out: proposals, reached, motions,
    combinations, plans, transforms and page.
    """
    patient = PatientModel.read(model)
    wished = read_wish(files=wish, model=patient, weights=settings["weights"], case=case, markups=markups)
    kept = None
    if settings["occlusion"] != "free":
        kept = Plan.read(occlusion, case) if occlusion else Plan(case, {})
    inverse = InverseSettings.of(settings)
    with closing(ElasticFace(patient, fem)) as face:
        made = answers(face, wished, settings["operations"], settings["bounds"], inverse, case, kept)
        most = max(made.values(), key=lambda answer: len(answer.freedom.low))
        against = contradictions(face, wished, most.freedom, inverse)
    certificates = {name: certify(patient, answer, fem) for name, answer in made.items()}
    width = half_widths(wished, patient, calibration)
    rows, reached, moved, combined = [], [], [], []
    for name, answer in made.items():
        key = {"case": case, "operation": name}
        rows.append(key | row(answer, certificates[name], wished, patient, inverse) | {"code": code})
        reached += [key | part for part in reached_rows(answer, wished, patient, inverse, width)]
        moved += [key | part for part in motion_rows(answer)]
        combined += [key | part for part in combination_rows(answer)]
        answer.proposal.plan.write(Path(out["plans"]) / f"{name}.json")
        write_transforms(answer.proposal.plan.motions, Path(out["transforms"]) / name)
    write_rows(rows, out["proposals"], PROPOSALS)
    write_rows(reached, out["reached"], REACHED)
    write_rows(moved, out["motions"], MOTIONS)
    write_rows(combined, out["combinations"], COMBINATIONS)
    write_wish_page(
        patient=patient,
        case=case,
        wish=wished,
        answers=made,
        rows=rows,
        reached=reached,
        against=against,
        certificates=certificates,
        settings=inverse,
        path=out["page"],
    )


def certify(patient: PatientModel, answer: Answer, fem: FemSettings) -> dict | None:
    """Certificate of the finite-element field of a proposal; None where they did not converge."""
    proposal = answer.proposal
    if not proposal.solved:
        return None
    solution = {"solver": True, "converged": True, "iterations": proposal.corrections, "load": 1.0, "reason": ""}
    said = measures(patient, proposal.plan, proposal.displacement, fem)
    return plain({"solution": solution, "measures": said, "models": None})


def row(answer: Answer, certificate, wish: Wish, patient: PatientModel, inverse: InverseSettings) -> dict:
    """The row of PROPOSALS."""
    proposal = answer.proposal
    return {
        "reached": all(item.error(proposal.displacement) <= inverse.met for item in wish),
        "wished": misfit(wish, np.zeros_like(patient.points)),
        "misfit": proposal.misfit,
        "motion_max": np.linalg.norm(patient.bone_displacement(proposal.plan), axis=1).max(),
        "at_bounds": ", ".join(f"{name} {quantity}" for name, quantity in proposal.at_bounds),
        "null_space": int(answer.combinations.hidden.sum()),
        "solved": certificate is not None,
        "grade": verdict(certificate).grade if certificate else "not usable",
        "corrections": proposal.corrections,
        "seconds": proposal.seconds,
    }


def half_widths(wish: Wish, patient: PatientModel, calibration: str | None) -> dict[str, float]:
    """Half-width (mm, degrees) of each wished measure or landmark by finite elements, where it is calibrated."""
    if calibration is None:
        return {}
    known = Calibration.read(calibration)
    widths = known.measures | {name: known.half_width.get(of) for name, of in regions_of(wish, patient).items()}
    return {name: width for name, width in widths.items() if width is not None}


def reached_rows(
    answer: Answer, wish: Wish, patient: PatientModel, inverse: InverseSettings, half_width: Mapping[str, float]
) -> list[dict]:
    """Rows of REACHED; half_width (mm) by wish."""
    rows = []
    for item in wish:
        error = item.error(answer.proposal.displacement)
        rows.append(
            {
                "wish": item.name,
                "unit": item.unit,
                "weight": item.weight,
                "wished": item.error(np.zeros_like(patient.points)),
                "error": error,
                "reached": error <= inverse.met,
                "half_width": half_width.get(item.name, np.nan),
            }
        )
    return rows


def motion_rows(answer: Answer) -> list[dict]:
    """Rows of MOTIONS: every segment of the operation."""
    bones = segment_points(answer.freedom.model)
    return [
        {"segment": name} | quantities(motion.about(bones[name].mean(axis=0)))
        for name, motion in answer.proposal.plan.motions.items()
    ]


def combination_rows(answer: Answer) -> list[dict]:
    """Rows of COMBINATIONS: what each does to every segment, as far as the wish does not feel it."""
    return [
        {"number": number, "bone": bone, "null_space": hidden, "segment": name} | quantities(motion)
        for number, (bone, hidden, moves) in enumerate(answer.moves(), 1)
        for name, motion in moves.items()
    ]


if __name__ == "__main__":
    attach_log(snakemake.log[0])
    propose_plans(
        case=snakemake.wildcards.case,
        model=snakemake.input.model,
        wish=snakemake.input.wish,
        markups=snakemake.input.get("markups", []),
        occlusion=next(iter(snakemake.input.get("occlusion", [])), None),
        calibration=next(iter(snakemake.input.get("calibration", [])), None),
        fem=FemSettings(**snakemake.params.fem),
        settings=snakemake.params.settings,
        code=snakemake.params.code,
        out=dict(snakemake.output.items()),
    )
