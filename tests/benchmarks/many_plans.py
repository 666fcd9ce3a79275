"""Many plans of one patient by kept factors, against Newton's method from rest, side by side in one run.

python tests/benchmarks/many_plans.py MODEL [MODEL ...] [--plans 8] [--newton 8] [--arms bonded mucosa]

MODEL: a `model.h5` of a study. The plans are sampled. They take turns: each is solved by Newton's method (the first
ones, where it would take too long) and by the kept factors. A line per model
and arm: seconds of the patient's preparation and per plan, median / most of Newton's method and of the kept
factors; iterations, median / most; median / largest difference of two fields in mm (of the largest
node) and largest one of their least J; plans without fallback; plans of either way that failed.
"""

import argparse
import os
import sys
import time
from pathlib import Path

# NumPy's own threads wait by spinning, and take the core from the second plan.
os.environ |= {"OPENBLAS_NUM_THREADS": "1", "OMP_WAIT_POLICY": "passive"}

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[2]))
sys.path.insert(0, str(Path(__file__).parents[2] / "workflow"))

from pinnochio.mechanics.boundary.conditions import boundary_conditions
from pinnochio.mechanics.solvers.kept_factors import KeptFactors
from pinnochio.mechanics.solvers.newton import solve
from pinnochio.model.patient import PatientModel
from pinnochio.plans.sampling import sample_plan
from tests.helpers.settings import fem_settings

HEAD = ("nodes", "arm", "plans", "preparation s", "Newton s", "kept s", "iterations", "field mm")
HEAD += ("least J", "without fallback", "failed: Newton, kept")


def timed(call):
    began = time.perf_counter()
    result = call()
    return result, time.perf_counter() - began


def measured(patient: PatientModel, plans: list, arm: str, newton: int) -> list[str]:
    settings = fem_settings()
    boundaries = [boundary_conditions(patient, plan, arm) for plan in plans]
    law, options = settings.material(patient.tissue), settings
    solver, preparation = timed(lambda: KeptFactors(patient.points, patient.cells, law, boundaries[0], options))
    solver.solve(boundaries[:1])  # loads compiled code
    exact, kept, exact_seconds, kept_seconds = [], [], [], []
    for number, boundary in enumerate(boundaries):
        (other,), seconds = timed(lambda boundary=boundary: solver.solve([boundary]))
        kept.append(other)
        kept_seconds.append(seconds)
        said = f"{arm} {number}: kept {seconds:.2f} s, {other.reason}, {other.iterations} iterations"
        if number < newton:
            mesh = patient.points, patient.cells
            one, seconds = timed(lambda boundary=boundary, mesh=mesh: solve(*mesh, law, boundary, options))
            exact.append(one)
            exact_seconds.append(seconds)
            off = np.linalg.norm(one.displacement - other.displacement, axis=1).max()
            said += f"; Newton {seconds:.2f} s, {one.reason}, {off:.1e} mm off"
        print(said, file=sys.stderr, flush=True)
    solver.close()
    good = [(one, other) for one, other in zip(exact, kept, strict=False) if one.converged and other.converged]
    off = [np.linalg.norm(one.displacement - other.displacement, axis=1).max() for one, other in good] or [np.nan]
    least = [abs(one.min_jacobian - other.min_jacobian) for one, other in good] or [np.nan]
    iterations = [result.iterations for result in kept if result.kept] or [0]
    failed = [sum(not result.converged for result in results) for results in (exact, kept)]
    return [
        f"{len(patient.points)}",
        arm,
        f"{len(plans)}",
        f"{preparation:.2f}",
        f"{np.median(exact_seconds or np.nan):.2f} / {max(exact_seconds, default=np.nan):.1f}",
        f"{np.median(kept_seconds):.3f} / {max(kept_seconds):.2f}",
        f"{np.median(iterations):.0f} / {max(iterations)}",
        f"{np.median(off):.0e} / {max(off):.0e}",
        f"{max(least):.0e}",
        f"{sum(result.kept for result in kept)} of {len(kept)}",
        f"{failed[0]}, {failed[1]}",
    ]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("models", nargs="+", type=Path)
    parser.add_argument("--plans", type=int, default=8)
    parser.add_argument("--arms", nargs="+", default=["bonded", "mucosa"])
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--newton", type=int, default=8, help="plans that Newton's method solves too")
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
            row = measured(patient, plans, arm, options.newton)
            print(f"| {model.parent.name} | " + " | ".join(row) + " |", flush=True)


if __name__ == "__main__":
    main()
