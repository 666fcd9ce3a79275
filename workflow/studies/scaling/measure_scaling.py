"""Makes the cost of every stage at one size of the mesh: one patient, each stage in a process of its own."""

import logging
import os
import tempfile
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pandas as pd
from torch.optim.optimizer import register_optimizer_step_post_hook
from tqdm import tqdm

from pinnochio.columns import write_csv
from pinnochio.experiments.measuring import DONE, Cost, measure
from pinnochio.files import megabytes
from pinnochio.hdf5 import reading
from pinnochio.logs import attach_log
from pinnochio.mechanics.settings import FemSettings
from pinnochio.model.predictions import read_prediction
from pinnochio.tables.scaling import SCALING
from pinnochio.training.device import choose_device
from scripts.prediction.predict import predict
from scripts.training.pretrain import pretrain

THREADS = ("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS")
FILES = ("labels", "bone", "skin", "report", "plan", "postop", "judged", "truth")


@dataclass(frozen=True)
class Stage:
    """A stage: what is counted, its function "module:name", the files it needs, the one it makes, and the arguments."""

    name: str
    unit: str
    function: str
    needs: Sequence[str]
    makes: str
    arguments: Mapping


def measure_scaling(
    case: str,
    target: int,
    files: Mapping[str, str],
    networks: Mapping[str, str],
    settings: Mapping,
    seed: int,
    table: str,
) -> None:
    """Write a row of SCALING per stage of the patient on a mesh of `target` nodes.

    files: its labels, bone, skin, report, plan and, where there are any, postop, judged and truth; networks: a trained
    one of each method; settings: sections of the configuration, `variants` those of the methods. What the stages make
    is thrown away; a stage that lacks what an earlier one did not make says so.
    """
    rows, limit = [], settings["scaling"]["time_limit"]
    with tempfile.TemporaryDirectory(dir=Path(table).parent) as folder:
        place = Path(folder)
        run = stages(
            case=case, target=target, files=files, networks=networks, settings=settings, seed=seed, folder=place
        )
        for stage in tqdm(list(run)):
            missing = [Path(path).stem for path in stage.needs if not Path(path).exists()]
            before = megabytes(folder)
            cost = Cost(f"not run: no {missing[0]}") if missing else measure(stage.function, stage.arguments, limit)
            done = cost.outcome == DONE
            logging.info("%s: %s", stage.name, cost)
            row = {"stage": stage.name, "unit": stage.unit, "target": target} | vars(cost)
            rows.append(row | {"written": megabytes(folder) - before if done else np.nan})
            if not done:
                Path(stage.makes).unlink(missing_ok=True)
        nodes = node_count(place / "model.h5")
    write_csv(pd.DataFrame(rows).assign(nodes=nodes), table, SCALING)


def stages(
    case: str, target: int, files: Mapping, networks: Mapping, settings: Mapping, seed: int, folder: Path
) -> Iterator[Stage]:
    """The stages one after another; arguments as of measure_scaling."""

    def file(name: str) -> str:
        return str(folder / name)

    mesh, model, fem_samples = file("mesh.vtu"), file("model.h5"), file("fem_samples.h5")
    fem = replace(FemSettings(**settings["fem"]), time_limit=settings["scaling"]["time_limit"])
    yield Stage(
        name="tetrahedralize",
        unit="job",
        function="scripts.patient.tetrahedralize:mesh_case",
        needs=[],
        makes=mesh,
        arguments={
            "labels": files["labels"],
            "nodes": target,
            "minimum_dihedral": settings["mesh"]["minimum_dihedral"],
            "mesh": mesh,
        },
    )
    yield Stage(
        name="label_interfaces",
        unit="job",
        function="scripts.patient.label_interfaces:label_case",
        needs=[mesh],
        makes=model,
        arguments={
            "mesh": mesh,
            **{name: files[name] for name in ("labels", "bone", "skin", "report")},
            "interfaces": settings["interfaces"],
            "model": model,
        },
    )
    yield Stage(
        name="simulate_fem",
        unit="plan",
        function="scripts.fem.simulate_fem:simulate_fem",
        needs=[model],
        makes=fem_samples,
        arguments={
            "case": case,
            "model": model,
            "plan": files["plan"],
            "plans": 1,
            "settings": fem,
            "seed": seed,
            "fem_samples": fem_samples,
        },
    )
    kinds = {method: settings["variants"][method]["network"]["lift"] for method in networks}
    lifts = {kind: file(f"lift_{kind}.h5") for kind in sorted(set(kinds.values()) - {"none"})}
    for kind, lift in lifts.items():
        yield Stage(
            name=f"make_lift {kind}",
            unit="job",
            function="scripts.patient.make_lift:write_lift",
            needs=[model],
            makes=lift,
            arguments={
                "model": model,
                "kind": kind,
                "controls": settings["lift"]["controls"],
                "fem": fem,
                "lift": lift,
            },
        )
    for method, network in networks.items():
        own, made, predictions = settings["variants"][method], file(f"{method}.pt"), file(f"{method}.h5")
        lift = [lifts[kinds[method]]] if kinds[method] in lifts else []
        patient = {"cases": [case], "models": [model], "lifts": lift}
        steps = own["pretraining"] | {"steps": settings["scaling"]["steps"] + 1}
        limited = settings["fem"] | {"time_limit": settings["scaling"]["time_limit"]}
        yield Stage(
            name=f"pretrain {method}",
            unit="step",
            function="studies.scaling.measure_scaling:training_step",
            needs=[model, *lift, fem_samples],
            makes=made,
            arguments={
                **patient,
                "fem_samples": [fem_samples],
                "settings": {"network": own["network"], "pretraining": steps, "fem": limited},
                "seed": seed,
                "outputs": {"network": made, "history": file("history.csv")},
            },
        )
        yield Stage(
            name=f"predict_network {method}",
            unit="plan",
            function="studies.scaling.measure_scaling:warm_plan",
            needs=[model, *lift],
            makes=predictions,
            arguments={
                **patient,
                "plans": [files["plan"]],
                "trained": network,
                "settings": {"newton_corrections": own["newton_corrections"], "fem": limited},
                "predictions": predictions,
            },
        )
    for method in list(networks)[:1]:  # its cost does not ask for the method
        metrics = file("metrics.csv")
        yield Stage(
            name="evaluate",
            unit="job",
            function="scripts.tables.evaluate:evaluate",
            needs=[model, file(f"{method}.h5")],
            makes=metrics,
            arguments={
                "cases": [case],
                "predictions": file(f"{method}.h5"),
                "models": [model],
                "plans": [files["plan"]],
                "postops": {case: files["postop"]} if files.get("postop") else {},
                "judged": {case: files["judged"]} if files.get("judged") else {},
                "truths": [files["truth"]] if files.get("truth") else [],
                "fem": fem,
                "labels": {"fold": "-", "method": method, "code": "-"},
                "seed": seed,
                "metrics": metrics,
            },
        )


def training_step(**arguments) -> tuple[float, float]:
    """Seconds and processor seconds of a step of pretraining on the CPU, median of all after the first."""
    marks = []
    hook = register_optimizer_step_post_hook(lambda *_: marks.append((time.perf_counter(), time.process_time())))
    pretrain(
        learner="pinnochio.methods.pinnochio.learner:GraphLearner", code="", device=choose_device(0, 1), **arguments
    )
    hook.remove()
    return tuple(np.median(np.diff(marks, axis=0), axis=0).tolist())


def warm_plan(**arguments) -> tuple[float, float]:
    """Seconds of a prediction on the CPU as the tables have it; of the processor's nothing is known."""
    predict(
        module="pinnochio.methods.pinnochio.predictor",
        device=choose_device(0, 1),
        threads=1,
        truths=[],
        covariates=[],
        **arguments,
    )
    return read_prediction(arguments["predictions"], arguments["cases"][0]).seconds, np.nan


def node_count(model: Path) -> float:
    """Nodes of a patient model, NaN where there is none."""
    if not model.exists():
        return np.nan
    with reading(model) as file:
        return len(file["points"])


if __name__ == "__main__":
    attach_log(snakemake.log[0])
    os.environ.update(dict.fromkeys(THREADS, "1"))  # of the stages' processes; the job has the machine for itself
    measure_scaling(
        case=snakemake.params.case,
        target=int(snakemake.wildcards.nodes),
        files={name: snakemake.input.get(name) for name in FILES},
        networks=dict(zip(snakemake.params.methods, snakemake.input.get("networks", []), strict=True)),
        settings=snakemake.params.sections | {"variants": snakemake.params.variants},
        seed=snakemake.params.seed,
        table=snakemake.output.table,
    )
