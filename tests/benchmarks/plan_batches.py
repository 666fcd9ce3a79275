"""Many plans of one patient in whole batches, on a GPU.

python tests/benchmarks/plan_batches.py MODEL [MODEL ...] [--device cuda] [--plans 512] [--slots 256] [--alone 16]
    [--fields FOLDER] [--arm bonded]

MODEL: a `model.h5` of a study. The plans are sampled. A line per model: seconds of the patient's preparation; in
milliseconds a plan that is solved alone, median / most, and the mean in the queue of all plans, whose motions are given
and whose fields end in the memory of the processor; iterations, median / most; plans that are left to the solver of one
plan (not timed); median / largest difference in mm from its fields (of the largest node), for as many plans as lie in
FOLDER, by the number of nodes and the arm, as written by `--write 6`; whether two runs gave the same bits. The first
run of each size, which compiles and records, is not counted.
"""

import argparse
import sys
import time
from pathlib import Path

import numpy as np
import torch

sys.path.insert(0, str(Path(__file__).parents[2]))
sys.path.insert(0, str(Path(__file__).parents[2] / "workflow"))

from pinnochio.mechanics.boundary.conditions import boundary_conditions
from pinnochio.mechanics.solvers.batched.plan_batches import BatchSolver
from pinnochio.mechanics.solvers.kept_factors import KeptFactors
from pinnochio.model.patient import PatientModel
from pinnochio.plans.sampling import sample_plan
from tests.helpers.settings import fem_settings

HEAD = (
    "nodes",
    "arm",
    "device",
    "preparation s",
    "alone ms",
    "in a queue ms",
    "iterations",
    "left",
    "field mm",
    "same bits",
)


def timed(call, device: str):
    began = time.perf_counter()
    result = call()
    if device != "cpu":
        torch.cuda.synchronize()
    return result, time.perf_counter() - began


def sampled(patient: PatientModel, count: int, seed: int, arm: str) -> list:
    rng, bones = np.random.default_rng(seed), (patient.bone_points, patient.bone_segment)
    keys = {"case": "sampled", "segments": patient.segments, "points": bones[0], "segment": bones[1]}
    return [boundary_conditions(patient, sample_plan(rng=rng, **keys), arm) for _ in range(count)]


def measured(patient: PatientModel, options: argparse.Namespace) -> list[str]:
    settings, device = fem_settings(), options.device
    boundaries = sampled(patient, options.plans, options.seed, options.arm)
    known = patient.points, patient.cells, settings.material(patient.tissue), boundaries[0], settings
    solver, preparation = timed(lambda: BatchSolver(*known, device, options.slots), device)
    asked = [solver.asked(item) for item in boundaries]
    solver.fields(asked[: options.slots])
    (fields, ways), seconds = timed(lambda: solver.fields(asked), device)
    same = np.array_equal(fields, solver.fields(asked)[0])
    solved, iterations = np.array([way.solved for way in ways]), [way.iterations for way in ways]
    print(f"{len(patient.points)}: {1e3 * seconds / len(asked):.3f} ms in a queue", file=sys.stderr, flush=True)
    alone = []
    for number in range(min(options.alone + 2, len(asked))):
        alone.append(1e3 * timed(lambda number=number: solver.fields(asked[number : number + 1]), device)[1])
    off, file = [np.nan], options.fields / f"{len(patient.points)}_{options.arm}.npy"
    if file.exists():
        pairs = zip(fields, np.load(file), solved, strict=False)
        off = [np.linalg.norm(one - other, axis=1).max() for one, other, good in pairs if good] or off
    return [
        f"{len(patient.points)}",
        options.arm,
        torch.cuda.get_device_name() if device != "cpu" else device,
        f"{preparation:.1f}",
        f"{np.median(alone[2:]):.1f} / {max(alone[2:], default=np.nan):.1f}",
        f"{1e3 * seconds / len(asked):.2f} ({len(asked)} plans)",
        f"{np.median(iterations):.0f} / {max(iterations)}",
        f"{(~solved).sum()} of {len(solved)}",
        f"{np.median(off):.0e} / {max(off):.0e}",
        "yes" if same else "no",
    ]


def write(patient: PatientModel, options: argparse.Namespace) -> None:
    settings, boundaries = fem_settings(), sampled(patient, options.write, options.seed, options.arm)
    known = patient.points, patient.cells, settings.material(patient.tissue), boundaries[0], settings
    solver = KeptFactors(*known)
    options.fields.mkdir(exist_ok=True)
    results = solver.solve(boundaries)
    np.save(options.fields / f"{len(patient.points)}_{options.arm}.npy", [result.displacement for result in results])
    solver.close()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("models", nargs="+", type=Path)
    parser.add_argument("--device", default="cuda")
    parser.add_argument("--plans", type=int, default=512)
    parser.add_argument("--slots", type=int, default=256)
    parser.add_argument("--alone", type=int, default=16)
    parser.add_argument("--arm", choices=["bonded", "mucosa"], default="bonded")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--fields", type=Path, default=Path("fields"))
    parser.add_argument("--write", type=int, default=0, help="write so many fields of the solver of one plan, and end")
    options = parser.parse_args()
    if options.write:
        for model in options.models:
            write(PatientModel.read(model), options)
        return
    print("| " + " | ".join(HEAD) + " |")
    print("|---" * len(HEAD) + "|", flush=True)
    for model in options.models:
        print("| " + " | ".join(measured(PatientModel.read(model), options)) + " |", flush=True)


if __name__ == "__main__":
    main()
