"""Measures what each reduction of a patient's model costs and saves, for the parts of the plan."""

import logging
import time
from dataclasses import replace

import numpy as np
import pandas as pd

from pinnochio.columns import write_csv
from pinnochio.experiments.reduction import face_error, solve_scene
from pinnochio.importing.segmentation import read_labels
from pinnochio.logs import attach_log
from pinnochio.mechanics.settings import FemSettings
from pinnochio.meshing.interfaces import label_interfaces
from pinnochio.meshing.lattice import tetrahedralize
from pinnochio.model.surfaces import BoneSurface, read_surface
from pinnochio.plans.plan import Plan
from pinnochio.plans.roles import role
from pinnochio.plans.scenarios import parts
from pinnochio.reduction.decisions import Decision, decide, write_decisions
from pinnochio.reduction.models import reduced
from pinnochio.reduction.settings import REDUCTIONS, SceneSettings
from pinnochio.tables.reductions import TRIALS


def measure_scene(
    case: str,
    files: dict[str, str],
    mesh: dict[str, float],
    interfaces: dict[str, float],
    fem: FemSettings,
    settings: SceneSettings,
    seed: int,
    code: str,
    table: str,
    scene: str,
) -> None:
    """Solve each part of the plan on the full model, with each reduction alone, and with those that are decided for.

    Writes the trials (table) and the decisions (scene, JSON). files: labels, bone, skin and plan as imported; mesh,
    interfaces: sections of the configuration. The full model is made here, so that its meshing is timed in the run
    that solves it.
    """
    head, bone, skin = read_labels(files["labels"]), BoneSurface.read(files["bone"]), read_surface(files["skin"])
    segments = bone.segments
    for nodes in (500, mesh["nodes"]):  # the first loads compiled code
        start = time.perf_counter()
        cells = tetrahedralize(
            labels=head.labels,
            spacing=head.spacing,
            origin=head.origin,
            target_nodes=nodes,
            minimum_dihedral=mesh["minimum_dihedral"],
        )
        full = label_interfaces(
            mesh=cells,
            labels=head.labels,
            spacing=head.spacing,
            origin=head.origin,
            segments=segments,
            bone=bone,
            skin=skin,
            **interfaces,
        )
        meshing = time.perf_counter() - start
    whole = Plan.read(files["plan"], case)
    chin = [index for index, name in enumerate(segments) if role(name) == "chin"]
    centre = bone.points[bone.segment == chin[0]].mean(axis=0) if chin else None
    solve_scene(patient=full, plan=whole, elastic=False, fem=replace(fem, time_limit=1e-3))
    rows, made = [], {}
    for name, plan in parts(whole, centre).items():
        motion = np.linalg.norm(full.bone_displacement(plan), axis=1).max()
        start = time.perf_counter()
        decided, field, limit = decide(
            patient=full,
            head=head,
            plan=plan,
            settings=settings,
            fem=fem,
            sliding_band=interfaces["sliding_band"],
            release=interfaces["release"],
        )
        deciding = time.perf_counter() - start
        made[name], reference = decided, None
        for model in ("full", *REDUCTIONS, "auto"):
            decisions = decided if model == "auto" else only(model, decided)
            start = time.perf_counter()
            patient = reduced(
                patient=full, head=head, skin=skin, decisions=decisions, field=field, limit=limit, interfaces=interfaces
            )
            reducing = time.perf_counter() - start
            own = [item for item in REDUCTIONS if decisions[item].value]
            graded = decisions["graded"].value
            trial = solve_scene(patient=patient, plan=plan, elastic=decisions["elastic"].value, fem=fem)
            reference = reference or trial
            mean, largest = face_error(full=full, reference=reference, patient=patient, trial=trial)
            logging.info("%s, %s: %d nodes, %.4f mm, at most %.3f mm", name, model, len(patient.points), mean, largest)
            rows.append(
                {
                    "case": case,
                    "plan": name,
                    "model": model,
                    "made": " ".join(own),
                    "seed": seed,
                    "code": code,
                    "motion": motion,
                    "nodes": len(patient.points),
                    "share": len(patient.points) / len(full.points),
                    "error_mean": mean,
                    "error_max": largest,
                    "decide_seconds": (deciding + (0 if graded else reducing)) if own else 0.0,
                    "mesh_seconds": reducing if graded else meshing,
                    "solve_seconds": trial.seconds,
                    "converged": trial.converged,
                }
            )
    write_csv(pd.DataFrame(rows), table, TRIALS)
    write_decisions(case, made, scene)


def only(reduction: str, decisions: dict[str, Decision]) -> dict[str, Decision]:
    """The decisions with one reduction made, or none, whatever the scene requires."""
    forced = {name: replace(decisions[name], value=name == reduction, by="hand") for name in REDUCTIONS}
    return decisions | forced


if __name__ == "__main__":
    attach_log(snakemake.log[0])
    measure_scene(
        case=snakemake.wildcards.case,
        files=dict(snakemake.input.items()),
        mesh=snakemake.params.mesh,
        interfaces=snakemake.params.interfaces,
        fem=FemSettings(**snakemake.params.fem),
        settings=SceneSettings(**snakemake.params.settings),
        seed=snakemake.params.seed,
        code=snakemake.params.code,
        table=snakemake.output.table,
        scene=snakemake.output.scene,
    )
