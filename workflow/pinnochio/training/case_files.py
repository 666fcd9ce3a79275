"""Files of a fold's training patients."""

import os
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pinnochio.errors import InputError
from pinnochio.hdf5 import reading
from pinnochio.plans.plan import Plan

File = str | os.PathLike


@dataclass(frozen=True)
class CaseFiles:
    """Files of one training patient: model and, for a network with a lift, its lift; the finite-element samples, or the
    plan and the post-operative skin, and the covariates of a method that reads them."""

    case: str
    model: File
    lift: File | None = None
    fem_samples: File | None = None
    plan: File | None = None
    postop: File | None = None
    covariates: File | None = None

    @property
    def inputs(self) -> list[File]:
        """The files that are there, but for the lift, which the model decides."""
        return [path for path in (self.model, self.fem_samples, self.plan, self.postop, self.covariates) if path]


def case_files(cases: Sequence[str], lifts: Sequence[str], **files: Sequence[str]) -> list[CaseFiles]:
    """Of each case; files: by the names of :class:`CaseFiles`, in the order of the cases, or none, as lifts may be."""
    rows = zip(cases, *(paths or [None] * len(cases) for paths in (lifts, *files.values())), strict=True)
    return [CaseFiles(case, lift=lift, **dict(zip(files, paths, strict=True))) for case, lift, *paths in rows]


def count_samples(files: CaseFiles) -> int:
    """Samples of a training patient: its finite-element samples, or its own plan."""
    if files.fem_samples is None:
        return 1
    with reading(files.fem_samples) as file:
        return len(file)


def read_fem_samples(path: File, case: str) -> list[tuple[Plan, np.ndarray]]:
    """Plans and displacement fields (n, 3) mm of the finite-element samples, in the order of their numbers.

    InputError where there is none.
    """
    with reading(path) as file:
        if not len(file):
            raise InputError(case, path, "holds no field", "simulate more plans")
        groups = sorted(file, key=lambda name: int(name.rsplit("_", 1)[-1]))
        return [(Plan.from_json(file[name].attrs["plan"], path), file[name]["displacement"][()]) for name in groups]
