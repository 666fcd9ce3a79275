"""The optimisation loop that pretraining and fine-tuning share."""

import csv
import json
import logging
import math
import os
import time
from collections.abc import Callable, Iterable, Mapping
from dataclasses import asdict, dataclass

import numpy as np
import torch
from torch import Tensor, nn

from pinnochio.files import replacing
from pinnochio.seeds import generator
from pinnochio.training.checkpoint import fingerprint, load_state, save_state
from pinnochio.training.muon import Muon
from pinnochio.training.progress import TrainingProgress
from pinnochio.training.settings import TrainingSettings

TERMS = ("data", "physics", "boundary")
# Losses and validation error of a row are those of the weights after `step` steps, nan where they were not measured;
# `kept` is 1 where the network ends with these weights.
COLUMNS = ("step", "learning_rate", "total", *TERMS, "physics_weight", "gradient", "validation", "kept")
GIVE_UP = 20  # steps in a row whose loss or gradient is not finite, before the run stops


@dataclass(frozen=True)
class Step:
    """What a step asks of the loss terms.

    samples: indices of the patients and plans; mirror: show them left-right mirrored; physics: whether the physics term
    is wanted; share: of all steps, done before this one; rng: for whatever else is drawn.
    """

    samples: tuple[int, ...]
    mirror: bool
    physics: bool
    share: float
    rng: np.random.Generator


Order = Callable[[np.random.Generator], np.ndarray]  # the samples of an epoch as they are shown, each once
Terms = Callable[[Step], Mapping[str, Tensor]]
# Leaves the gradient of the weighted sum of a step's terms in the parameters, and gives the terms.
Gradients = Callable[[Step, Mapping[str, float]], Mapping[str, Tensor]]


def train(
    network: nn.Module,
    terms: Terms,
    samples: int,
    settings: TrainingSettings,
    *,
    order: Order | None = None,
    phase: str,
    seed: int,
    code: str,
    checkpoint: str | os.PathLike,
    history: str | os.PathLike,
    validate: Callable[[], float] | None = None,
    inputs: Iterable[str | os.PathLike] = (),
    gradients: Gradients | None = None,
) -> None:
    """Train `network` in place and write the loss history, a row of COLUMNS per step.

    terms(step) gives the terms "data", "boundary" and, where wanted, "physics". validate() gives the error of
    the weights on patients that are not trained on: the network ends with the weights that it was least at,
    among those reached under the full loss (after physics_ramp); without it, with the last.
    gradients: takes the place of `terms` and their derivative (:mod:`pinnochio.training.recording`); order: see Order.

    Samples, mirroring and `rng` depend on (seed, phase, step) alone, so a run that was killed and starts again
    from `checkpoint` ends as an unbroken one, on a CPU to the last bit. A checkpoint of other settings, first
    weights, `code` (a hash) or content of the files `inputs` is not taken up. The caller deletes it once the result is
    safe. A step whose loss or gradient is not finite is skipped; RuntimeError after 20 of them in a row.
    """
    device = next(network.parameters()).device
    optimizer = _deterministic_optimizer(network, settings)
    signature = json.dumps([phase, seed, samples, asdict(settings), fingerprint(network, inputs, code)], sort_keys=True)
    rows, start, failures, best = _resume(load_state(checkpoint, signature, device), network, optimizer, phase)
    network.train()
    progress, saved = TrainingProgress(phase, start, settings.steps), time.monotonic()

    def keep(step: int) -> None:
        """Write what a further start goes on from."""
        state = {"network": network.state_dict(), "optimizer": optimizer.state_dict(), "signature": signature}
        save_state(checkpoint, state | {"rows": rows, "step": step, "failures": failures, "best": vars(best)})

    for step in range(start, settings.steps + 1):
        rising = _share(step, settings.physics_ramp * settings.steps) if settings.weights["physics"] else 1.0
        looked = validate and (step % settings.validate_every == 0 or step == settings.steps)
        measured = best.check(step, network, validate, counts=rising == 1) if looked else math.nan
        if step == settings.steps:
            if validate:
                rows.append([step] + [math.nan] * (len(COLUMNS) - 3) + [measured])
            break
        rate = settings.learning_rate * schedule(step, settings)
        drawn = _draw(step, samples, settings, phase, seed, order)
        weights = dict(settings.weights) | {"physics": settings.weights["physics"] * rising}
        values = gradients(drawn, weights) if gradients else terms(drawn)
        loss, norm, values = _descend(network, optimizer, values, weights, rate, settings.clip, not gradients)
        failures = 0 if math.isfinite(loss) and math.isfinite(norm) else failures + 1
        if failures:
            logging.warning("%s: step %d skipped, loss %g, gradient %g", phase, step, loss, norm)
        if failures == GIVE_UP:
            raise RuntimeError(f"{phase}: the loss is not finite {GIVE_UP} steps in a row")
        rows.append(
            [step, rate, loss, *(values.get(name, math.nan) for name in TERMS), weights["physics"], norm, measured]
        )
        progress.update(step + 1, values, rate, best.note)
        due = (step + 1) % settings.checkpoint_every == 0 or time.monotonic() - saved > settings.checkpoint_seconds
        if due and step + 1 < settings.steps:
            keep(step + 1)
            saved = time.monotonic()
    if best.weights is not None:
        logging.info("%s: %s", phase, best.note)
        network.load_state_dict(best.weights)
    network.eval()
    _write_history(history, rows, None if best.weights is None else best.step)


def _deterministic_optimizer(network: nn.Module, settings: TrainingSettings) -> torch.optim.Optimizer:
    """One whose steps can be repeated, on a CPU to the last bit."""
    on_cpu = next(network.parameters()).device.type == "cpu"
    torch.use_deterministic_algorithms(True, warn_only=not on_cpu)
    torch.utils.deterministic.fill_uninitialized_memory = False  # every element is written
    return Muon(
        network.parameters(),
        settings.muon,
        lr=settings.learning_rate,
        betas=(settings.beta1, settings.beta2),
        weight_decay=settings.weight_decay,
        fused=True,
    )


def _resume(
    state: dict | None, network: nn.Module, optimizer: torch.optim.Optimizer, phase: str
) -> tuple[list, int, int, "Best"]:
    """Rows, step, failures in a row and best weights of the state, whose weights are restored; a start without one."""
    if state is None:
        return [], 0, 0, Best()
    network.load_state_dict(state["network"])
    optimizer.load_state_dict(state["optimizer"])
    logging.info("%s: resumed at step %d", phase, state["step"])
    return state["rows"], state["step"], state["failures"], Best(**state["best"])


def _draw(step: int, samples: int, settings: TrainingSettings, phase: str, seed: int, order: Order | None) -> Step:
    rng = generator(seed, phase, f"step {step}")
    mirror = bool(settings.mirror and rng.random() < 0.5)
    shown = tuple(sample_at(step * settings.batch + n, samples, seed, phase, order) for n in range(settings.batch))
    return Step(shown, mirror, bool(settings.weights["physics"]), step / settings.steps, rng)


def _descend(
    network: nn.Module,
    optimizer: torch.optim.Optimizer,
    values: Mapping[str, Tensor],
    weights: Mapping[str, float],
    rate: float,
    clip: float,
    differentiate: bool,
) -> tuple[float, float, dict[str, float]]:
    """One step, unless loss or gradient are not finite: the loss, the gradient's norm, the terms.

    differentiate: whether the gradient is still to be taken of the terms.
    """
    total = sum(weights[name] * value for name, value in values.items() if weights[name])
    if differentiate:
        optimizer.zero_grad()
        total.backward()
    gradient = nn.utils.clip_grad_norm_(network.parameters(), clip)
    # One transfer of all numbers of the step, because each makes the processor wait for the GPU.
    loss, norm, *numbers = torch.stack([total, gradient, *values.values()]).tolist()
    if math.isfinite(loss) and math.isfinite(norm):
        for group in optimizer.param_groups:
            group["lr"] = rate
        optimizer.step()
    return loss, norm, dict(zip(values, numbers, strict=True))


def _write_history(path: str | os.PathLike, rows: Iterable[list[float]], kept: int | None) -> None:
    with replacing(path) as temporary, open(temporary, "w", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(COLUMNS)
        writer.writerows([f"{value:.6g}" for value in (*row, float(row[0] == kept))] for row in rows)


@dataclass
class Best:
    """Least validation error, the step and weights that gave it, and the last error."""

    error: float = math.inf
    step: int = 0
    last: float = math.nan
    weights: dict[str, Tensor] | None = None

    def check(self, step: int, network: nn.Module, validate: Callable[[], float], counts: bool) -> float:
        """Error of the network's weights; they are kept if they count and are the best."""
        network.eval()
        with torch.no_grad():
            self.last = validate()
        network.train()
        if counts and self.last < self.error:
            self.error, self.step = self.last, step
            self.weights = {name: value.clone() for name, value in network.state_dict().items()}
        return self.last

    @property
    def note(self) -> str:
        """The last and the least error in words; empty before the first check."""
        if math.isnan(self.last):
            return ""
        least = "" if self.weights is None else f" (least {self.error:.4g} at step {self.step})"
        return f"validation {self.last:.4g}{least}"


def schedule(step: int, settings: TrainingSettings) -> float:
    """Share of the full learning rate: linear warm-up, then a cosine down to zero after the last step, or decay."""
    steps = settings.steps
    rise = max(1, round(settings.warmup * steps)) if settings.warmup else 0
    if step < rise:
        return (step + 1) / (rise + 1)
    if settings.decay:
        return max(settings.decay ** int(step / (settings.decay_every * steps)), settings.decay_floor)
    return 0.5 * (1 + math.cos(math.pi * (step - rise) / max(1, steps - rise)))


def sample_at(number: int, samples: int, seed: int, phase: str, order: Order | None = None) -> int:
    """Sample that is shown as so manyth: every epoch shows all of them, in an order of its own."""
    epoch, place = divmod(number, samples)
    rng = generator(seed, phase, f"epoch {epoch}")
    return int((order(rng) if order else rng.permutation(samples))[place])


def _share(step: int, length: float) -> float:
    """How much of a linear rise over `length` steps is done in step number `step`."""
    return min(1.0, (step + 1) / length) if length > 0 else 1.0
