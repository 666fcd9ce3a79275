"""How near to the converged field each accuracy comes, and in what seconds; with --front the file models/front.json.

python tests/benchmarks/accuracy.py MODEL [MODEL ...] [--plans 40] [--networks 10] [--front FILE]

MODEL: a `model.h5` of a study, its `lift_elastic.h5` beside it. Sampled plans, sliding; the settings take turns, each
plan is solved once by each. Distances: of the judged points of the face from the field at a residual of 1e-6 (`exact`),
at the worst point. Seconds: of the processor, one thread, one plan of a patient whose factors are there. Networks: the
first one of the shipped archive, on so many plans of each patient, corrected as in predictions.
"""

import argparse
import json
import os
import sys
import time
from dataclasses import replace
from datetime import date
from pathlib import Path

os.environ |= dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS"), "1")

import numpy as np
import pandas as pd

sys.path.insert(0, str(Path(__file__).parents[2]))
sys.path.insert(0, str(Path(__file__).parents[2] / "workflow"))

from pinnochio.json_text import write_json
from pinnochio.mechanics import simulation
from pinnochio.mechanics.lift import Lift
from pinnochio.mechanics.settings import EXACT
from pinnochio.mechanics.simulation import Simulator
from pinnochio.mechanics.solvers.kept_factors import ESTIMATE, KeptFactors
from pinnochio.methods.pinnochio.predictor import GraphPredictor
from pinnochio.methods.protocol import Planned
from pinnochio.model.patient import PatientModel
from pinnochio.plans.sampling import sample_plan
from scripts.tables.provenance import processor
from tests.helpers.settings import CONFIG, ROOT, fem_settings

ACCURACIES = 0.02, 0.05, 0.1, 0.2, 0.5
NETWORK = "pinnochio_plus"


class Watched(KeptFactors):
    """Kept factors that remember the last estimate of what is still to come, mm."""

    estimate = np.nan

    def _near_enough(self, trajectory, motion) -> bool:
        if self._watched is not None:
            Watched.estimate = float(ESTIMATE * np.linalg.norm(self._watched @ motion, axis=1).max())
        return super()._near_enough(trajectory, motion)


def measure(model: Path, plans: int, networks: int, seed: int) -> list[dict]:
    """One row per plan and setting of a patient: mm at the worst point and in the mean, estimate mm, seconds."""
    patient, rng, case = PatientModel.read(model), np.random.default_rng(seed), model.parent.name
    anatomy = {"segments": patient.segments, "points": patient.bone_points, "segment": patient.bone_segment}
    sampled = [sample_plan(rng, case, **anatomy) for _ in range(plans)]
    solvers = {("elastic", ""): Simulator(patient, fem_settings(), linear=True)}
    solvers |= {("fem_sliding", one): Simulator(patient, fem_settings(accuracy=one)) for one in (EXACT, *ACCURACIES)}
    ways = {key: lambda plan, solver=solver: solver.solve([plan])[0] for key, solver in solvers.items()}
    if networks:
        lift, settings = Lift.read(model.with_name("lift_elastic.h5")), {"fem": CONFIG["fem"], "newton_corrections": 10}
        network = GraphPredictor(settings, ROOT / f"models/{NETWORK}/1.pt", "cpu", 1)
        planned = Planned(case, patient, sampled[0], lift, warm=False)
        ways[NETWORK, ""] = lambda plan: network(replace(planned, plan=plan))
    rows = []
    for warm in ways.values():  # loads compiled code
        warm(sampled[0])
    for number, plan in enumerate(sampled):
        used = [key for key in ways if key[0] != NETWORK or number < networks]
        fields = {}
        for key in used[number % len(used) :] + used[: number % len(used)]:
            Watched.estimate, spent = np.nan, []
            for _ in range(5 if key[0] == "elastic" else 1):
                began = time.process_time()
                fields[key] = ways[key](plan)
                spent.append(time.process_time() - began)
            row = {"case": case, "plan": number, "method": key[0], "accuracy": key[1], "seconds": np.median(spent)}
            rows.append(row | {"estimate": Watched.estimate, "converged": fields[key].converged})
        exact = fields["fem_sliding", EXACT].displacement
        for row in rows[-len(used) :]:
            field = fields[row["method"], row["accuracy"]]
            off = np.linalg.norm(patient.onto_judged @ (field.displacement - exact), axis=1)
            row |= {"mm": off.max(), "mm_mean": off.mean(), "kept": getattr(field, "kept", True)}
        print(case, number, *(f"{row['accuracy']}:{row['mm']:.4f}" for row in rows[-len(used) :]), file=sys.stderr)
    for solver in solvers.values():
        solver.close()
    return rows


def summarise(rows: pd.DataFrame) -> pd.DataFrame:
    """The settings, fastest first: mm, shares of the seconds of `exact`, multiples of those of `elastic`; within,
    efficiency, worst: share of plans nearer than the accuracy, mm over the estimate (median), over the accuracy (most).

    front: nearer than all faster ones by more than the standard error of that over patients.
    """
    rows = rows.fillna({"accuracy": ""})
    rows["accuracy"] = rows["accuracy"].astype(str)
    plans = rows.set_index(["case", "plan"])
    for name, key in (("share", ("fem_sliding", EXACT)), ("times", ("elastic", ""))):
        of = plans[(plans["method"] == key[0]) & (plans["accuracy"] == key[1])]["seconds"]
        plans[name] = plans["seconds"] / of.reindex(plans.index)
    settings, fields = [], {}
    for (method, accuracy), group in plans.groupby(["method", "accuracy"], sort=False):
        one = {"method": method, "accuracy": accuracy, "plans": len(group), "failed": int((~group["converged"]).sum())}
        one |= {name: group[name].median() for name in ("seconds", "share", "times")}
        one |= {f"{name}_95": group[name].quantile(0.95) for name in ("share", "times", "mm")}
        one |= {"mm": group["mm"].mean(), "mm_max": group["mm"].max(), "mm_mean": group["mm_mean"].mean()}
        if accuracy not in ("", EXACT):
            one |= {"within": (group["mm"] <= float(accuracy)).mean(), "worst": group["mm"].max() / float(accuracy)}
            one |= {"efficiency": (group["mm"] / group["estimate"]).median()}
        fields[len(settings)] = group["mm"]
        settings.append(one)
    frame, last = pd.DataFrame(settings).sort_values("times"), None
    for number in frame.index:
        gain = np.array([np.inf]) if last is None else (last - fields[number]).dropna().groupby("case").mean()
        frame.loc[number, "front"] = last is None or gain.mean() > gain.std() / np.sqrt(len(gain))
        last = fields[number] if frame.loc[number, "front"] else last
    return frame


def write_front(frame: pd.DataFrame, rows: pd.DataFrame, nodes: float, path: Path) -> None:
    """What `predict.seconds` chooses by, and when, where and on whom it was measured."""
    names = ["method", "accuracy", "plans", "mm", "mm_95", "times", "times_95", "seconds", "front"]
    settings = json.loads(frame[names].round(4).to_json(orient="records"))
    for one in settings:
        one["accuracy"] = one["accuracy"] if one["accuracy"] in ("", EXACT) else float(one["accuracy"])
    made = {"date": str(date.today()), "machine": f"{processor()}, one thread", "nodes": round(nodes)}
    write_json(path, made | {"patients": sorted(rows["case"].unique()), "settings": settings})


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("models", nargs="+", type=Path)
    parser.add_argument("--plans", type=int, default=40)
    parser.add_argument("--networks", type=int, default=10)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--rows", type=Path, help="file of all rows; those of another run, if it is there already")
    parser.add_argument("--front", type=Path, help="file of the front")
    options = parser.parse_args()
    simulation.KeptFactors = Watched
    if options.rows and options.rows.is_file():
        rows = pd.read_csv(options.rows)
    else:
        rows = pd.DataFrame(
            row for model in options.models for row in measure(model, options.plans, options.networks, options.seed)
        )
        if options.rows:
            rows.to_csv(options.rows, index=False)
    frame = summarise(rows)
    print(frame.round(4).to_csv(sep="|", index=False))
    if options.front:
        nodes = np.mean([len(PatientModel.read(model).points) for model in options.models])
        write_front(frame, rows, nodes, options.front)


if __name__ == "__main__":
    main()
