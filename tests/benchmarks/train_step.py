"""A training step of the network with this project's attention layers and with torch_geometric's, in one run.

python tests/benchmarks/train_step.py --case results/cases/V01 [--device cuda] [--config config/config.yaml ...]

Reads model.h5 and plan.json of the case; the layers take turns. Prints the milliseconds of each part of a step and of a
prediction (medians), their ratio (median over the repeats), on a GPU the memory of a step and what a large copy moves
per second, and the largest difference of a parameter's gradient relative to its norm; exits with 1 if that is above
1e-4. The max-pool takes the winners of torch_geometric's run in both: where two neighbours tie to the last digit, the
gradient of either is right. On one thread of the processor the clock is the process's own, which other work on the
machine disturbs less.

With --once a GPU makes one warm step, alone seen by a profiler that waits for it; what it moves is the sum of
ncu --profile-from-start off --clock-control none --csv --metrics dram__bytes.sum python tests/benchmarks/train_step.py
"""

import argparse
import sys
import time
from contextlib import contextmanager, nullcontext
from pathlib import Path

import numpy as np
import torch

sys.path.insert(0, str(Path(__file__).parents[2]))
sys.path.insert(0, str(Path(__file__).parents[2] / "workflow"))

from pinnochio.mechanics.settings import FemSettings
from pinnochio.methods.pinnochio.losses import boundary_loss, physics_loss, volume_loss
from pinnochio.methods.pinnochio.patient import tensors
from pinnochio.model.patient import PatientModel
from pinnochio.networks import boundary
from pinnochio.networks.building import build
from pinnochio.networks.gatv2 import Attention
from pinnochio.overlays import read_merged
from pinnochio.plans.plan import Plan
from tests.helpers.settings import network_settings

TOLERANCE = 1e-4
PARTS = ("forward", "losses", "backward", "optimiser")


class Problem:
    """A network with random weights, a patient under its plan, and the optimiser."""

    def __init__(self, case: Path, config: dict, device: str):
        settings = network_settings(**config["network"])
        model = PatientModel.read(case / "model.h5")
        self.patient = tensors(model, FemSettings(**config["fem"]), settings, device)
        self.signal = self.patient.signal(Plan.from_json((case / "plan.json").read_text(), case / "plan.json"))
        self.weights = config["pretraining"]["weights"]
        torch.manual_seed(0)
        self.network = build(settings)
        with torch.no_grad():  # decoders start at zero, which would leave nothing to the layers before them
            for weight in self.network.parameters():
                if not weight.any():
                    weight.normal_(0, 0.01)
        self.network.to(device)
        self.optimizer = torch.optim.AdamW(self.network.parameters(), lr=1e-6, fused=True)
        self.device = device
        alone = device == "cpu" and torch.get_num_threads() == 1
        self.now = time.process_time if alone else time.perf_counter

    def predict(self):
        with torch.inference_mode():
            self.network(self.patient.anatomy, self.signal)

    def step(self, clock=lambda: None) -> dict[str, torch.Tensor]:
        """One training step; the gradients by parameter. clock() is called before and after each of PARTS."""
        clock()
        prediction = self.network(self.patient.anatomy, self.signal)
        clock()
        target = self.signal.cue
        terms = {
            "data": volume_loss(prediction.displacement, target),
            "boundary": boundary_loss(prediction, target, torch.ones_like(prediction.known)),
            "physics": physics_loss(self.patient.operator, self.patient.free, prediction.displacement),
        }
        total = sum(self.weights[name] * value for name, value in terms.items())
        clock()
        self.optimizer.zero_grad()
        total.backward()
        clock()
        gradients = {name: weight.grad for name, weight in self.network.named_parameters()}
        torch.nn.utils.clip_grad_norm_(self.network.parameters(), 1e9)
        self.optimizer.step()
        clock()
        return gradients

    def timed(self, job) -> list[float]:
        """Milliseconds between the calls of the clock that `job` gets."""
        marks = []

        def clock():
            if self.device == "cuda":
                torch.cuda.synchronize()
            marks.append(self.now())

        job(clock)
        return list(1e3 * np.diff(marks))

    def predict_timed(self, clock):
        clock()
        self.predict()
        clock()


@contextmanager
def torch_geometric_layers():
    """Inside, the layers compute with torch_geometric's kernels."""
    own = Attention.forward
    Attention.forward = Attention.general
    try:
        yield
    finally:
        Attention.forward = own


@contextmanager
def kept_winners(winners: list):
    """Inside, the max-pool takes `winners`, one tensor of indices per call; an empty list is filled first."""
    own, calls, fill = boundary.max_pool, iter(list(winners)), not winners

    def max_pool(features, neighbours):
        gathered = features.index_select(0, neighbours.flatten()).view(*neighbours.shape, -1)
        if fill:
            winners.append(gathered.detach().argmax(1, keepdim=True))
            return gathered.gather(1, winners[-1])[:, 0]
        return gathered.gather(1, next(calls))[:, 0]

    boundary.max_pool = max_pool
    try:
        yield
    finally:
        boundary.max_pool = own


def difference(problem: Problem) -> tuple[float, str]:
    """The largest relative difference of a gradient, and the parameter's name."""
    winners, start = [], {name: value.clone() for name, value in problem.network.state_dict().items()}
    with torch_geometric_layers(), kept_winners(winners):
        theirs = {name: value.clone() for name, value in problem.step().items()}
    problem.network.load_state_dict(start)
    with kept_winners(winners):
        ours = {name: value.clone() for name, value in problem.step().items()}
    problem.network.load_state_dict(start)
    differences = {name: float((ours[name] - theirs[name]).norm() / theirs[name].norm()) for name in ours}
    worst = max(differences, key=lambda name: (np.isnan(differences[name]), differences[name]))
    return differences[worst], worst


def copied_per_second(gigabytes: float = 4.0) -> float:
    """GB read and written per second by a copy on the GPU."""
    source = torch.empty(int(gigabytes * 1e9), dtype=torch.uint8, device="cuda")
    target, seconds = torch.empty_like(source), []
    for _ in range(6):
        torch.cuda.synchronize()
        began = time.perf_counter()
        target.copy_(source)
        torch.cuda.synchronize()
        seconds.append(time.perf_counter() - began)
    return 2 * gigabytes / np.median(seconds[1:])


def show_one_step(problem: Problem) -> None:
    """One warm step between the marks that a profiler waits for."""
    for warm in (False, False, True):
        if warm:
            torch.cuda.cudart().cudaProfilerStart()
        problem.step()
        torch.cuda.synchronize()
    torch.cuda.cudart().cudaProfilerStop()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--case", type=Path, required=True, help="folder with model.h5 and plan.json")
    parser.add_argument("--config", type=Path, nargs="+", default=[Path("config/config.yaml")])
    parser.add_argument("--device", choices=["cpu", "cuda"], default="cpu")
    parser.add_argument("--threads", type=int, default=1, help="of the processor")
    parser.add_argument("--repeats", type=int, default=9)
    parser.add_argument("--once", action="store_true", help="one step for a profiler")
    options = parser.parse_args()
    torch.set_num_threads(options.threads)
    config = read_merged(options.config)
    problem = Problem(options.case, config, options.device)
    if options.once:
        return show_one_step(problem)
    error, worst = difference(problem)
    steps, predictions, memory = ([], []), ([], []), [0, 0]
    for repeat in range(options.repeats + 1):
        for kind in (0, 1):
            with torch_geometric_layers() if kind else nullcontext():
                if options.device == "cuda":
                    torch.cuda.reset_peak_memory_stats()
                one = problem.timed(problem.step)
                if options.device == "cuda":
                    memory[kind] = torch.cuda.max_memory_allocated()
                two = problem.timed(problem.predict_timed)
            if repeat:  # the first one warms up
                steps[kind].append([*one, sum(one)])
                predictions[kind].append(two)
    rows = np.concatenate([np.array(steps), np.array(predictions)], axis=2)
    nodes = len(problem.patient.points)
    print(f"{nodes} nodes, {options.device}, {options.threads} threads of the processor, {options.repeats} repeats\n")
    print("| part | ours ms | torch_geometric ms | ratio |\n|---|---|---|---|")
    for name, ours, theirs in zip((*PARTS, "whole step", "prediction"), *rows.transpose(0, 2, 1), strict=True):
        print(f"| {name} | {np.median(ours):.1f} | {np.median(theirs):.1f} | {np.median(theirs / ours):.2f} |")
    if options.device == "cuda":
        print(f"\npeak memory of a step: {memory[0] / 2**20:.0f} MiB, torch_geometric {memory[1] / 2**20:.0f} MiB")
        print(f"a copy moves {copied_per_second():.0f} GB/s, read and written")
    print(f"\nlargest relative difference of a gradient: {error:.1e} ({worst})")
    if not error <= TOLERANCE:
        sys.exit(f"the gradients differ by more than {TOLERANCE:g}")


if __name__ == "__main__":
    main()
