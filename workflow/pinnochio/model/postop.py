"""The registered post-operative skin of a patient, as a file."""

import os
from dataclasses import dataclass

import numpy as np

from pinnochio.hdf5 import reading, writing


@dataclass(frozen=True)
class PostopSkin:
    """Points (k, 3) mm in the patient's frame, faces (l, 3), and the median residual of the registration, mm.

    face_p95, face_bias: how far the registration may be off on the face that is judged, mm: the 95th percentile of the
    distance along the normals, and the bound that its mean keeps in 95 %; NaN where that is not known.
    """

    points: np.ndarray
    faces: np.ndarray
    residual: float
    face_p95: float = np.nan
    face_bias: float = np.nan

    @property
    def surface(self) -> tuple[np.ndarray, np.ndarray]:
        """Points and faces."""
        return self.points, self.faces

    @property
    def columns(self) -> dict[str, float]:
        """What a row of cases.csv says of the registration."""
        return {
            "registration_residual": self.residual,
            "registration_p95": self.face_p95,
            "registration_bias": self.face_bias,
        }

    def write(self, path: str | os.PathLike) -> None:
        """Write the skin as HDF5."""
        with writing(path) as file:
            file.create_dataset("points", data=self.points, track_times=False)
            file.create_dataset("faces", data=np.asarray(self.faces, np.int32), track_times=False)
            file.attrs.update(self.columns)

    @classmethod
    def read(cls, path: str | os.PathLike) -> "PostopSkin":
        """Read what :meth:`write` wrote."""
        with reading(path) as file:
            names = ("registration_residual", "registration_p95", "registration_bias")
            return cls(file["points"][()], file["faces"][()], *(float(file.attrs[name]) for name in names))
