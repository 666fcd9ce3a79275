"""Measures what solving only what a plan requires saves on a patient, for the parts of the plan."""

import logging
import time
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from pinnochio.columns import write_rows
from pinnochio.experiments.reduction import Way, face_error, tried
from pinnochio.importing.segmentation import read_labels
from pinnochio.logs import attach_log
from pinnochio.mechanics.settings import FemSettings
from pinnochio.meshing.interfaces import label_interfaces, opposing_pairs
from pinnochio.meshing.lips import bite
from pinnochio.meshing.refinement import refine_mouth
from pinnochio.meshing.tetrahedralize import tetrahedralize
from pinnochio.model.patient import PatientModel
from pinnochio.model.surfaces import BoneSurface, read_surface
from pinnochio.plans.plan import Plan
from pinnochio.plans.roles import role
from pinnochio.plans.scenarios import parts
from pinnochio.tables.reductions import TRIALS


def measure_scene(
    case: str,
    files: dict[str, str],
    config: dict[str, dict],
    methods: dict[str, dict],
    seed: int,
    code: str,
    table: str,
) -> None:
    """Solve each part of the plan on the whole patient and on what it requires, by each of the methods.

    On meshes finer than the study's, plans of which all is solved are left out: either way is the same there.
    files: labels, bone, skin and plan as imported; config: sections mesh, interfaces, fem_rlse and scene; methods: the
    settings of each (fem, contact), with mesh, "study" or "lips". Seconds are those of the processor.
    """
    whole, rows = Plan.read(files["plan"], case), []
    for mesh, target, patient, meshing in patients(files, config):
        chin = [index for index, name in enumerate(patient.segments) if role(name) == "chin"]
        centre = patient.bone_points[patient.bone_segment == chin[0]].mean(axis=0) if chin else None
        for method, own in methods.items():
            if own["mesh"] != mesh:
                continue
            fem = FemSettings(**own["fem"])
            full = Way(own["contact"], fem)
            ways = {"full": full, "auto": replace(full, amplitude=config["scene"]["amplitude"])}
            plans = parts(whole, centre)
            if mesh == "lips" or target > config["mesh"]["nodes"]:
                solver = ways["auto"].solver(patient)
                plans = {name: plan for name, plan in plans.items() if not solver.required(plan).all()}
                solver.close()
            if method not in {row["method"] for row in rows}:  # load compiled code
                tried(patient, whole, replace(full, settings=replace(fem, time_limit=1e-3)))
            for name, plan in plans.items():
                reference = None
                for model, way in ways.items():
                    trial = tried(patient, plan, way)
                    reference = reference or trial
                    mean, largest = face_error(patient, reference, trial)
                    rows.append(
                        {
                            "case": case,
                            "method": method,
                            "target": target,
                            "plan": name,
                            "model": model,
                            "seed": seed,
                            "code": code,
                            "motion": np.linalg.norm(patient.bone_displacement(plan), axis=1).max(),
                            "nodes": len(patient.points),
                            "share": trial.share,
                            "error_mean": mean,
                            "error_max": largest,
                            "decide_seconds": trial.deciding,
                            "mesh_seconds": meshing,
                            "first_seconds": trial.first,
                            "further_seconds": trial.further,
                            "converged": trial.converged,
                        }
                    )
                    logging.info("%s, %s: %s", method, name, rows[-1])
    write_rows(rows, table, TRIALS)


def patients(files: dict[str, str], config: dict[str, dict]) -> Iterator[tuple[str, int, PatientModel, float]]:
    """Kind of mesh, nodes asked for, the patient on it, seconds of meshing and labelling: "study" with each of the
    numbers of nodes, then "lips"."""
    head, bone, skin = read_labels(files["labels"]), BoneSurface.read(files["bone"]), read_surface(files["skin"])
    place = {"labels": head.labels, "spacing": head.spacing, "origin": head.origin}
    least, band = config["mesh"]["minimum_dihedral"], config["interfaces"]["sliding_band"]
    tetrahedralize(**place, target_nodes=500, minimum_dihedral=least)  # loads compiled code
    mouth = bite(bone, opposing_pairs(bone, *place.values(), bone.segments, band), band)
    for count, kind in [*((count, "study") for count in config["scene"]["nodes"]), (config["mesh"]["nodes"], "lips")]:
        start = time.process_time()
        mesh = tetrahedralize(**place, target_nodes=count, minimum_dihedral=least)
        if kind == "lips":
            mesh = refine_mouth(mesh, mouth, config["fem_rlse"]["lip_edge"])
        made = label_interfaces(
            mesh=mesh, **place, segments=bone.segments, bone=bone, skin=skin, **config["interfaces"]
        )
        yield kind, count, made, time.process_time() - start


if __name__ == "__main__":
    attach_log(snakemake.log[0])
    measure_scene(
        case=snakemake.wildcards.case,
        files=dict(snakemake.input.items()),
        config=snakemake.params.config,
        methods=snakemake.params.methods,
        seed=snakemake.params.seed,
        code=snakemake.params.code,
        table=snakemake.output.table,
    )
