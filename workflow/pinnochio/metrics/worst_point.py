"""How far a predicted skin is from all other predictions of the same patient, at the point where that is most."""

import os
from collections.abc import Iterable, Mapping
from dataclasses import replace

import numpy as np

from pinnochio.hdf5 import reading, writing
from pinnochio.metrics.judged import Judged
from pinnochio.model.patient import PatientModel

FLAGGED = 5.0  # mm from every other prediction beyond which a point is to be looked at [I]
EVERY = 4  # of the judged samples one in so many is compared: their distance is then about 2 mm


def compared(judged: Judged, patient: PatientModel, moved) -> np.ndarray:
    """Where a method takes some of the judged samples (k, 3) mm, the same of every method of a case; moved (s, 3) mm:
    the skin points of its model."""
    return replace(judged, skin=judged.skin[::EVERY]).carried(patient, moved)


def apart(skin, others: Iterable[np.ndarray]) -> float:
    """Largest distance in mm of a point of the skin (k, 3) from the nearest of the other predictions of that point,
    each (k, 3); NaN without others."""
    distances = [np.linalg.norm(skin - other, axis=1) for other in others]
    return float(np.min(distances, axis=0).max()) if distances else np.nan


def write_skins(path: str | os.PathLike, skins: Mapping[str, np.ndarray]) -> None:
    """Write points (k, 3) mm by case as HDF5."""
    with writing(path) as file:
        for case, points in skins.items():
            file.create_dataset(case, data=np.asarray(points, np.float32), compression="gzip", track_times=False)


def read_skins(path: str | os.PathLike) -> dict[str, np.ndarray]:
    """Read what :func:`write_skins` wrote."""
    with reading(path) as file:
        return {case: file[case][()].astype(float) for case in file}
