"""The optimisation loop that pretraining and fine-tuning share."""

import csv
import json
import logging
import math
import os
from collections.abc import Callable, Mapping
from dataclasses import asdict
from pathlib import Path

import numpy as np
import torch
from torch import Tensor, nn
from tqdm import tqdm

from pinnochio.files import replacing
from pinnochio.seeds import generator
from pinnochio.training.checkpoint import load_state, save_state
from pinnochio.training.settings import TrainingSettings

COLUMNS = ("step", "learning_rate", "total", "data", "physics", "boundary", "physics_weight", "gradient")
PATIENCE = 20  # steps in a row whose loss or gradient is not finite, before the run is given up

# Loss terms by name of sample `index`; the physics term may be left out where its weight is zero.
Terms = Callable[[int, float, bool, np.random.Generator], Mapping[str, Tensor]]


def train(
    network: nn.Module,
    terms: Terms,
    samples: int,
    settings: TrainingSettings,
    *,
    phase: str,
    seed: int,
    ramp: float,
    checkpoint: str | os.PathLike,
    history: str | os.PathLike,
) -> None:
    """Train `network` in place for `settings.steps` steps and write the loss history.

    terms(sample, physics weight, mirror, rng) gives the terms "data", "physics" and "boundary". The order of
    the samples, the mirroring and `rng` depend on (seed, phase, step) alone, so a run resumed from
    `checkpoint` ends as an unbroken one. A step whose loss or gradient is not finite is skipped; RuntimeError
    after 20 of them in a row.
    """
    device = next(network.parameters()).device
    torch.use_deterministic_algorithms(True, warn_only=device.type != "cpu")
    optimizer = torch.optim.AdamW(
        network.parameters(), lr=settings.learning_rate, weight_decay=settings.weight_decay, fused=True
    )
    signature = json.dumps([phase, seed, samples, ramp, asdict(settings)], sort_keys=True)
    rows, start, failures = [], 0, 0
    if state := load_state(checkpoint, signature, device):
        network.load_state_dict(state["network"])
        optimizer.load_state_dict(state["optimizer"])
        rows, start, failures = state["rows"], state["step"], state["failures"]
        logging.info("%s: resumed at step %d", phase, start)
    network.train()
    bar = tqdm(range(start, settings.steps), phase, initial=start, total=settings.steps, mininterval=10)
    for step in bar:
        rate = settings.learning_rate * schedule(step, settings.steps, settings.warmup)
        for group in optimizer.param_groups:
            group["lr"] = rate
        rising = min(1.0, (step + 1) / (ramp * settings.steps)) if ramp > 0 else 1.0
        weights = {**settings.weights, "physics": settings.weights["physics"] * rising}
        rng = generator(seed, phase, f"step {step}")
        mirror = bool(settings.mirror and rng.random() < 0.5)
        found = terms(sample_at(step, samples, seed, phase), weights["physics"], mirror, rng)
        total = sum(weights[name] * value for name, value in found.items() if weights[name])
        optimizer.zero_grad()
        total.backward()
        gradient = nn.utils.clip_grad_norm_(network.parameters(), settings.clip)
        if math.isfinite(total.item()) and math.isfinite(gradient.item()):
            optimizer.step()
            failures = 0
        else:
            failures += 1
            shown = phase, step, total.item(), gradient.item()
            logging.warning("%s: step %d skipped, loss %g, gradient %g", *shown)
            if failures == PATIENCE:
                raise RuntimeError(f"{phase}: the loss is not finite {PATIENCE} steps in a row")
        values = {name: value.item() for name, value in found.items()}
        rows.append([step, rate, total.item()] + [values.get(n, 0.0) for n in COLUMNS[3:6]])
        rows[-1] += [weights["physics"], gradient.item()]
        shown = {name: f"{value:.3g}" for name, value in values.items()}
        bar.set_postfix(shown | {"lr": f"{rate:.2g}"}, refresh=False)
        if (step + 1) % settings.checkpoint_every == 0 and step + 1 < settings.steps:
            state = {"network": network.state_dict(), "optimizer": optimizer.state_dict()}
            state |= {"signature": signature, "rows": rows, "step": step + 1, "failures": failures}
            save_state(checkpoint, state)
    network.eval()
    with replacing(history) as temporary, open(temporary, "w", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(COLUMNS)
        writer.writerows([f"{value:.6g}" for value in row] for row in rows)
    Path(checkpoint).unlink(missing_ok=True)


def schedule(step: int, steps: int, warmup: float) -> float:
    """Share of the full learning rate: linear warm-up, then a cosine that reaches zero after the last step."""
    rise = max(1, round(warmup * steps))
    if step < rise:
        return (step + 1) / (rise + 1)
    return 0.5 * (1 + math.cos(math.pi * (step - rise) / max(1, steps - rise)))


def sample_at(step: int, samples: int, seed: int, phase: str) -> int:
    """Sample of a step: every epoch shows all of them, in an order of its own."""
    epoch, place = divmod(step, samples)
    return int(generator(seed, phase, f"epoch {epoch}").permutation(samples)[place])
