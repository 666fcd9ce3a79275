"""Predicted displacement fields of one fold and method, case by case."""

import os
from collections.abc import Mapping
from dataclasses import asdict, dataclass

import h5py
import numpy as np

from pinnochio.files import replacing


@dataclass(frozen=True)
class Prediction:
    """Displacement (n, 3) mm of every node, with how it came about.

    seconds: one plan, warm, without reading files; setup_seconds: what belongs to the patient and serves every plan.
    """

    displacement: np.ndarray
    seconds: float = 0.0
    setup_seconds: float = 0.0
    threads: int = 1
    device: str = "cpu"
    converged: bool = True
    reason: str = "no solver"
    iterations: int = 0


def write_predictions(path: str | os.PathLike, predictions: Mapping[str, Prediction]) -> None:
    """Write one HDF5 group per case."""
    with replacing(path) as temporary, h5py.File(temporary, "w", track_order=True) as file:
        for case, prediction in predictions.items():
            group = file.create_group(case)
            values = asdict(prediction)
            group.create_dataset("displacement", data=values.pop("displacement"), track_times=False)
            group.attrs.update(values)


def read_prediction(path: str | os.PathLike, case: str) -> Prediction:
    """Read the prediction of one case; raises KeyError where the file does not hold it."""
    with h5py.File(path, "r") as file:
        group = file[case]
        values = {key: value.item() if hasattr(value, "item") else value for key, value in group.attrs.items()}
        return Prediction(group["displacement"][()], **values)
