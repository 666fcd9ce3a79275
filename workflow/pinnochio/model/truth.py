"""The truth of a virtual patient: where all of the tissue went, and how the plan was carried out."""

import os
from dataclasses import dataclass

import numpy as np

from pinnochio.errors import REMEDY, InputError
from pinnochio.geometry.interpolation import interpolate
from pinnochio.hdf5 import reading, writing
from pinnochio.model.patient import PatientModel
from pinnochio.plans.plan import Plan


def read_truth(path: str | os.PathLike, case: str) -> tuple[np.ndarray, np.ndarray, np.ndarray, Plan]:
    """Points (n, 3) mm, cells (m, 4), displacement (n, 3) mm and the executed plan of a simulated outcome.

    Evaluation and the bounds read them, no method does.
    """
    with reading(path) as file:
        field = (file[name][()] for name in ("points", "cells", "displacement"))
        return *field, Plan.from_json(file.attrs["executed"], path, case)


def read_expected(path: str | os.PathLike, case: str) -> np.ndarray:
    """Displacement (n, 3) mm of the points of :func:`read_truth` that plan, anatomy and covariates decide.

    InputError where the outcome is older than this field.
    """
    with reading(path) as file:
        if "expected" not in file:
            raise InputError(case, path, "it has no expected displacement", REMEDY)
        return file["expected"][()]


@dataclass(frozen=True)
class TrueMotion:
    """The truth where a model of the patient has points: displacement (n, 3) mm of its nodes, (s, 3) mm of its skin.

    The outcome's own mesh is another one; a point outside of it takes the value at the closest point there.
    """

    nodes: np.ndarray
    skin: np.ndarray

    @classmethod
    def of(cls, patient: PatientModel, points, cells, displacement) -> "TrueMotion":
        """Of a truth on points (n, 3) mm and cells (m, 4), as :func:`read_truth` gives it."""
        places = np.concatenate([patient.points, patient.skin_points])
        there = interpolate(places, points, cells, displacement)
        return cls(*np.split(there, [len(patient.points)]))

    def write(self, path: str | os.PathLike) -> None:
        """Write as HDF5."""
        with writing(path) as file:
            for name, values in vars(self).items():
                file.create_dataset(name, data=values, track_times=False)

    @classmethod
    def read(cls, path: str | os.PathLike, patient: PatientModel, case: str) -> "TrueMotion":
        """Read what :meth:`write` wrote of this model; InputError where it was another."""
        with reading(path) as file:
            motion = cls(file["nodes"][()], file["skin"][()])
        there, here = (motion.nodes.shape, motion.skin.shape), (patient.points.shape, patient.skin_points.shape)
        if there != here:
            raise InputError(case, path, f"it is of another mesh: shapes {there} instead of {here}", REMEDY)
        return motion
