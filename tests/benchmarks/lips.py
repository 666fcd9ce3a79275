"""Whether lips cross or gape as they are shown: on a patient's predictions and on sampled plans.

python tests/benchmarks/lips.py MODEL [MODEL ...] [--plans 5] [--predictions FOLDER ...]

MODEL: a `model.h5`, of the study or of a new patient. Sampled plans are solved by sliding finite elements; predictions:
folders with `{fold}/{method}/predictions.h5`, of which each that holds the patient is read.
"""

import argparse
import sys
from collections.abc import Iterator
from pathlib import Path

import h5py
import numpy as np
import pandas as pd

sys.path.insert(0, str(Path(__file__).parents[2]))
sys.path.insert(0, str(Path(__file__).parents[2] / "workflow"))

from pinnochio.mechanics.held_lips import CROSSED, OPEN, held_lips
from pinnochio.mechanics.simulation import Simulator
from pinnochio.model.patient import PatientModel
from pinnochio.model.predictions import read_prediction
from pinnochio.plans.sampling import sample_plan
from tests.helpers.settings import fem_settings


def fields(model: Path, plans: int, folders: list[Path]) -> Iterator[tuple[str, np.ndarray]]:
    """Name and displacement (n, 3) mm of each field of a patient."""
    patient, rng, case = PatientModel.read(model), np.random.default_rng(1), model.parent.name
    for folder in folders:
        for path in sorted(folder.glob("*/*/predictions.h5")):
            with h5py.File(path) as file:
                there = case in file
            field = read_prediction(path, case).displacement if there else None
            if field is not None and len(field) == len(patient.points):
                yield f"{folder.name} {path.parent.name}", field
    anatomy = {"segments": patient.segments, "points": patient.bone_points, "segment": patient.bone_segment}
    with Simulator(patient, fem_settings()) as solver:
        for _ in range(plans):
            yield "sampled plan", solver.solve([sample_plan(rng, case, **anatomy)])[0].displacement


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("models", nargs="+", type=Path)
    parser.add_argument("--plans", type=int, default=5)
    parser.add_argument("--predictions", nargs="*", type=Path, default=[])
    options, rows = parser.parse_args(), []
    for model in options.models:
        patient = PatientModel.read(model)
        for name, field in fields(model, options.plans, options.predictions):
            lips = held_lips(patient, field)
            shown = held_lips(patient, lips.displacement, closing=0.0).crossed
            row = {"case": model.parent.name, "field": name, "crossed": lips.crossed, "crossed_shown": shown}
            rows.append(row | {"before": lips.before, "parted": lips.parted, "left": lips.left})
        print(model.parent.name, file=sys.stderr)
    frame = pd.DataFrame(rows)
    many = {name: frame[name] > CROSSED for name in ("crossed", "crossed_shown")}
    many |= {"left": frame["left"] > np.maximum(frame["before"], OPEN)}
    counts = pd.DataFrame(many).groupby(frame["field"], sort=False).agg(["size", "sum"])
    most = frame.groupby("field", sort=False)[list(many)].max()
    print(
        f"fields, and those with lips that cross by {CROSSED:g} mm, or lie {OPEN:g} mm and farther apart than before:"
    )
    print(counts.to_string(), "most, mm:", most.round(2).to_string(), "worst as shown:", sep="\n")
    print(frame.sort_values("crossed_shown").tail(5).round(2).to_string())


if __name__ == "__main__":
    main()
