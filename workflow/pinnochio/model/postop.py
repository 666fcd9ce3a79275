"""The registered post-operative skin of a patient, as a file."""

import os
from dataclasses import dataclass

import numpy as np

from pinnochio.hdf5 import reading, writing


@dataclass(frozen=True)
class PostopSkin:
    """Points (k, 3) mm in the patient's frame, faces (l, 3), and the median residual of the registration, mm."""

    points: np.ndarray
    faces: np.ndarray
    residual: float

    @property
    def surface(self) -> tuple[np.ndarray, np.ndarray]:
        """Points and faces."""
        return self.points, self.faces

    def write(self, path: str | os.PathLike) -> None:
        """Write the skin as HDF5."""
        with writing(path) as file:
            file.create_dataset("points", data=self.points, track_times=False)
            file.create_dataset("faces", data=np.asarray(self.faces, np.int32), track_times=False)
            file.attrs["registration_residual"] = self.residual

    @classmethod
    def read(cls, path: str | os.PathLike) -> "PostopSkin":
        """Read what :meth:`write` wrote."""
        with reading(path) as file:
            return cls(file["points"][()], file["faces"][()], float(file.attrs["registration_residual"]))
