"""Many plans of one patient by kept factors, against Newton's method from rest, side by side in one run.

python tests/benchmarks/many_plans.py MODEL [MODEL ...] [--plans 8] [--arms bonded mucosa] [--batch 8]

MODEL: a `model.h5` of a study. The plans are sampled. They take turns: each is solved by Newton's method and by the
kept factors alone; then all together in batches. A line per model and arm, of plans that Newton's method solves:
seconds of the patient's preparation and, median per plan, of the three ways; iterations, median / most; largest
difference of two fields and of their least J; share of plans without fallback, and plans of either way that failed.
"""

import argparse
import sys
import time
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[2]))
sys.path.insert(0, str(Path(__file__).parents[2] / "workflow"))

from pinnochio.mechanics.repeated import RepeatedSolver
from pinnochio.mechanics.simulation import simulate, solver_options
from pinnochio.mechanics.sliding import boundary_conditions
from pinnochio.model.patient import PatientModel
from pinnochio.plans.sampling import sample_plan
from tests.helpers.settings import fem_settings

HEAD = ("nodes", "arm", "plans", "preparation s", "Newton s", "kept s", "in batches s", "iterations", "field mm")
HEAD += ("least J", "without fallback", "failed: Newton, kept")


def timed(call):
    began = time.perf_counter()
    result = call()
    return result, time.perf_counter() - began


def measured(patient: PatientModel, plans: list, arm: str, batch: int, seconds: float) -> list[str]:
    settings = fem_settings(time_limit=seconds)
    boundaries = [boundary_conditions(patient, plan, arm) for plan in plans]
    law, options = settings.material(patient.tissue), solver_options(settings)
    solver, preparation = timed(lambda: RepeatedSolver(patient.points, patient.cells, law, boundaries[0], options))
    solver.solve(boundaries[:1])  # loads compiled code
    newton, kept, spent = [], [], []
    for number, (plan, boundary) in enumerate(zip(plans, boundaries, strict=True)):
        one, first = timed(lambda plan=plan: simulate(patient, plan, arm, settings))
        (other,), second = timed(lambda boundary=boundary: solver.solve([boundary]))
        newton.append(one)
        kept.append(other)
        spent.append((first, second))
        off = np.linalg.norm(one.displacement - other.displacement, axis=1).max()
        print(
            f"{arm} {number}: Newton {first:.2f} s, {one.reason}; kept {second:.2f} s, {other.reason}, "
            f"{other.iterations} iterations, fallback {not other.kept}, {off:.1e} mm",
            file=sys.stderr,
            flush=True,
        )
    together = []
    for start in range(0, len(boundaries), batch):
        part = boundaries[start : start + batch]
        together += [timed(lambda part=part: solver.solve(part))[1] / len(part)] * len(part)
    solver.close()
    good = [i for i, (one, other) in enumerate(zip(newton, kept, strict=True)) if one.converged and other.converged]
    off = [np.linalg.norm(newton[i].displacement - kept[i].displacement, axis=1).max() for i in good]
    least = [abs(newton[i].min_jacobian - kept[i].min_jacobian) for i in good]
    iterations = [result.iterations for result in kept if result.kept] or [0]
    failed = [sum(not result.converged for result in results) for results in (newton, kept)]
    first, second = np.median([spent[i] for i in good] or [(np.nan, np.nan)], axis=0)
    return [
        f"{len(patient.points)}",
        arm,
        f"{len(plans)}",
        f"{preparation:.2f}",
        f"{first:.2f}",
        f"{second:.2f}",
        f"{np.median(together):.2f}",
        f"{np.median(iterations):.0f} / {max(iterations)}",
        f"{max(off, default=np.nan):.0e}",
        f"{max(least, default=np.nan):.0e}",
        f"{sum(result.kept for result in kept)} of {len(kept)}",
        f"{failed[0]}, {failed[1]}",
    ]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("models", nargs="+", type=Path)
    parser.add_argument("--plans", type=int, default=8)
    parser.add_argument("--batch", type=int, default=8)
    parser.add_argument("--arms", nargs="+", default=["bonded", "mucosa"])
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--seconds", type=float, default=600, help="time limit of one solution by Newton's method")
    options = parser.parse_args()
    print("| model | " + " | ".join(HEAD) + " |")
    print("|---" * (len(HEAD) + 1) + "|", flush=True)
    for model in options.models:
        patient, rng = PatientModel.read(model), np.random.default_rng(options.seed)
        plans = [
            sample_plan(
                rng=rng,
                case=model.parent.name,
                segments=patient.segments,
                points=patient.bone_points,
                segment=patient.bone_segment,
            )
            for _ in range(options.plans)
        ]
        for arm in options.arms:
            row = measured(patient, plans, arm, options.batch, options.seconds)
            print(f"| {model.parent.name} | " + " | ".join(row) + " |", flush=True)


if __name__ == "__main__":
    main()
