"""How far a predicted skin is from all other predictions of the same patient, at the point where that is most."""

import os
from collections.abc import Iterable, Mapping

import numpy as np

from pinnochio.hdf5 import reading, writing

FLAGGED = 5.0  # mm from every other prediction beyond which a point is to be looked at [I]
EVERY = 4  # of the judged samples one in so many is compared: their distance is then about 2 mm


def apart(skin, others: Iterable[np.ndarray]) -> float:
    """Largest distance in mm of a point of the skin (k, 3) from the nearest of the other predictions of that point,
    each (k, 3); NaN without others."""
    distances = [np.linalg.norm(skin - other, axis=1) for other in others]
    return float(np.min(distances, axis=0).max()) if distances else np.nan


def write_skins(path: str | os.PathLike, skins: Mapping[str, np.ndarray]) -> None:
    """Write by case where a method takes one in EVERY of the judged samples (k, 3) mm, as HDF5."""
    with writing(path) as file:
        for case, points in skins.items():
            file.create_dataset(case, data=np.asarray(points, np.float32), compression="gzip", track_times=False)


def read_skins(path: str | os.PathLike) -> dict[str, np.ndarray]:
    """Read what :func:`write_skins` wrote."""
    with reading(path) as file:
        return {case: file[case][()].astype(float) for case in file}
