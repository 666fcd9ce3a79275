"""A training step with its kernels recorded and replayed, and with each of them launched, in one run on a GPU.

python tests/benchmarks/recorded_step.py --case results/cases/V01 [--config config/config.yaml config/paper.yaml]

Reads model.h5 and plan.json (or motion.json) of the case. A step is the loop's: draw, loss terms, their gradient, its
norm, the optimiser, one transfer of the numbers. Of pretraining (the target is the plan's cue) and, where postop.h5 is
there, of fine-tuning; the two kinds take turns. Prints medians in milliseconds and the ratio, the seconds that a
recording takes once, the memory, and the largest difference of a parameter's gradient relative to its norm beside that
between two launched steps; exits with 1 if a recorded gradient is further off than 3e-3.
"""

import argparse
import sys
import time
from pathlib import Path

import numpy as np
import torch

sys.path.insert(0, str(Path(__file__).parents[2] / "workflow"))

from pinnochio.mechanics.settings import FemSettings
from pinnochio.methods.pinnochio.learner import GraphLearner, Sample
from pinnochio.methods.pinnochio.losses import SurfaceLoss, volume_loss
from pinnochio.methods.pinnochio.patient import tensors
from pinnochio.model.patient import PatientModel
from pinnochio.model.postop import PostopSkin
from pinnochio.overlays import read_merged
from pinnochio.plans.plan import Plan
from pinnochio.training.device import choose_device
from pinnochio.training.loop import Step
from pinnochio.training.recording import RecordedGradients

TOLERANCE = 3e-3


def make_samples(case: Path, config: dict, learners: dict[str, GraphLearner], device: str) -> dict[str, Sample]:
    """A sample of each phase whose files are there."""
    model = PatientModel.read(case / "model.h5")
    patient = tensors(model, FemSettings(**config["fem"]), next(iter(learners.values())).network, device)
    plan = next(case / name for name in ("motion.json", "plan.json") if (case / name).is_file())
    signal = patient.signal(Plan.from_json(plan.read_text(encoding="utf-8"), plan))
    everywhere, cue = torch.ones_like(patient.reliable), signal.cue
    samples = {"pretrain": Sample(patient, signal, volume_loss, lambda rng: (cue,), cue, everywhere)}
    if (case / "postop.h5").is_file():
        training = learners["finetune"].training
        skin = PostopSkin.read(case / "postop.h5").surface
        surface = SurfaceLoss(patient, *skin, training.surface_samples, training.surface_cutoff)
        samples["finetune"] = Sample(patient, signal, surface.between, surface.draw, signal.cue, signal.reliable)
    return samples


class Steps:
    """The steps of a network on one sample, recorded or not."""

    def __init__(self, learner: GraphLearner, sample: Sample, recorded: bool, device: str):
        self.learner, self.sample, self.weights = learner, sample, dict(learner.training.weights)
        torch.manual_seed(0)
        self.network = learner.build(learner.network)
        with torch.no_grad():  # decoders start at zero, which would leave nothing to the layers before them
            for weight in self.network.parameters():
                if not weight.any():
                    weight.normal_(0, 0.01)
        self.network.to(device)
        self.optimizer = torch.optim.AdamW(self.network.parameters(), lr=1e-9, weight_decay=0.0, fused=True)
        piece = lambda index, step: learner.piece(self.network, sample, step)  # noqa: E731
        self.recorded = RecordedGradients(self.network, piece) if recorded else None

    def gradient(self, number: int) -> dict[str, torch.Tensor]:
        """That of a step; its number decides what is drawn and whether the patient is mirrored."""
        step = Step((0,), number % 2 == 1, bool(self.weights["physics"]), 0.0, np.random.default_rng(number))
        if self.recorded:
            return self.recorded(step, self.weights)
        values = self.learner.terms(self.network, [self.sample], step)
        self.optimizer.zero_grad()
        sum(self.weights[name] * value for name, value in values.items()).backward()
        return values

    def __call__(self, number: int) -> list[float]:
        values = self.gradient(number)
        total = sum(self.weights[name] * value for name, value in values.items())
        norm = torch.nn.utils.clip_grad_norm_(self.network.parameters(), 1.0)
        numbers = torch.stack([total, norm, *values.values()]).tolist()
        self.optimizer.step()
        return numbers


def measure(learner: GraphLearner, sample: Sample, device: str, repeats: int) -> float:
    """Print the comparison; the largest difference of a gradient."""
    kinds = {"launched": Steps(learner, sample, False, device), "recorded": Steps(learner, sample, True, device)}
    began = time.perf_counter()
    for number in (0, 1):
        kinds["recorded"].gradient(number)
    first = time.perf_counter() - began
    found = []
    for kind in ("launched", "launched", "recorded"):
        kinds[kind].gradient(2)
        found.append({name: weight.grad.clone() for name, weight in kinds[kind].network.named_parameters()})

    def apart(one, other):
        return max(float((one[name] - other[name]).norm() / other[name].norm().clamp_min(1e-20)) for name in one)

    again, error = apart(found[1], found[0]), apart(found[2], found[0])
    times = {kind: [] for kind in kinds}
    for number in range(repeats + 2):
        for kind, steps in kinds.items():
            if device == "cuda":
                torch.cuda.synchronize()
            began = time.perf_counter()
            steps(number)
            if device == "cuda":
                torch.cuda.synchronize()
            if number > 1:  # the first ones warm up
                times[kind].append(1e3 * (time.perf_counter() - began))
    launched, recorded = (np.median(times[kind]) for kind in ("launched", "recorded"))
    print(f"launched {launched:.2f} ms, recorded {recorded:.2f} ms: {launched / recorded:.2f} times as fast")
    print(f"two recordings {first:.2f} s; gradient off by {error:.1e}, two launched ones by {again:.1e}", flush=True)
    return error


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--case", type=Path, nargs="+", required=True, help="folders")
    parser.add_argument("--config", type=Path, nargs="+", default=[Path("config/config.yaml")])
    parser.add_argument("--device", choices=["cpu", "cuda"], default="cuda")
    parser.add_argument("--repeats", type=int, default=20)
    asked = parser.parse_args()
    device = choose_device(asked.device == "cuda", 1)
    torch.use_deterministic_algorithms(True, warn_only=device != "cpu")
    config, errors = read_merged(asked.config), []
    settings = {name: config[name] for name in ("network", "fem", "pretraining", "finetuning")}
    learners = {phase: GraphLearner(settings, phase, device) for phase in ("pretrain", "finetune")}
    for case in asked.case:
        for phase, sample in make_samples(case, config, learners, device).items():
            print(f"{case.name}, {phase}, {len(sample.patient.points)} nodes, {device}:")
            errors.append(measure(learners[phase], sample, device, asked.repeats))
    if device == "cuda":
        print(f"peak memory of the GPU: {torch.cuda.max_memory_allocated() / 2**30:.2f} GiB")
    if not max(errors) <= TOLERANCE:
        sys.exit(f"recorded gradients differ by more than {TOLERANCE:g}")


if __name__ == "__main__":
    main()
