"""The interval of a new patient's prediction: calibrated half-widths, wider where the fold models disagree."""

import os
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field, fields, replace

import numpy as np
from scipy.special import ndtri

from pinnochio.errors import InputError
from pinnochio.geometry.triangles import vertex_normals
from pinnochio.hdf5 import reading, writing
from pinnochio.json_text import read_stored_json, write_json
from pinnochio.mechanics.settings import FemSettings
from pinnochio.mechanics.solvers.inversion_repair import Repair, repair_inversions
from pinnochio.model.patient import FREE, PatientModel
from pinnochio.model.regions import NAMES, regions


@dataclass(frozen=True)
class Calibration:
    """What a method's interval is made of: half_width and usual_spread in mm by region name, None where unknown.

    level: share that the half-width covers; patients: held-out ones that it was calibrated on, by folds models;
    measures: half-width of each of the face's measures, mm or degrees, none in an archive from before there were any.
    """

    method: str
    level: float
    patients: int
    folds: int
    half_width: dict[str, float | None]
    usual_spread: dict[str, float | None]
    measures: dict[str, float | None] = field(default_factory=dict)

    @property
    def by_region(self) -> np.ndarray:
        """half_width (r + 1,) mm in the order of NAMES, NaN where unknown; the last, NaN, is that of code -1."""
        return np.array([*map(self.half_width.get, NAMES), None], float)

    def write(self, path: str | os.PathLike) -> None:
        """Write as JSON."""
        write_json(path, asdict(self))

    @classmethod
    def read(cls, path: str | os.PathLike) -> "Calibration":
        """Read what :meth:`write` wrote."""
        stored = read_stored_json(path)
        stored.setdefault("measures", {})
        return stored.of(cls)


@dataclass(frozen=True)
class Interval:
    """displacement (n, 3) mm, the mean of the fold models; spread (n,) mm, how far they lie from it (root mean square).

    Over the skin points: half_width (s,) mm, within which the outcome should pass, NaN where nothing is judged or
    calibrated; region (s,) int8 (anatomy.regions). forces (n, 3) mN: the load that the mean field declares, if any.
    """

    displacement: np.ndarray
    spread: np.ndarray
    half_width: np.ndarray
    region: np.ndarray
    forces: np.ndarray | None = None

    def write(self, path: str | os.PathLike, **about) -> None:
        """Write as HDF5; `about` as attributes."""
        with writing(path) as file:
            for name, values in vars(self).items():
                if values is not None:
                    file.create_dataset(name, data=values, track_times=False)
            file.attrs.update(about | {"regions": NAMES, "units": "mm"})

    @classmethod
    def read(cls, path: str | os.PathLike) -> "Interval":
        """Read what :meth:`write` wrote."""
        with reading(path) as file:
            return cls(**{item.name: file[item.name][()] for item in fields(cls) if item.name in file})


def read_ensemble(path: str | os.PathLike) -> np.ndarray:
    """Displacements (k, n, 3) mm of a patient by the networks of k folds."""
    with reading(path) as file:
        return np.stack([group["displacement"][()] for group in file.values()])


def read_load(path: str | os.PathLike) -> np.ndarray | None:
    """Mean load (n, 3) mN that the fields of an ensemble declare; None where they declare none."""
    with reading(path) as file:
        loads = [group["forces"][()] for group in file.values() if "forces" in group]
    return np.mean(loads, axis=0) if loads else None


def skin_spread(patient: PatientModel, displacements) -> np.ndarray:
    """Standard deviation (s,) mm of the skin over the models (k, n, 3), k > 1, along the normal of their mean.

    Along the normal, because motion within the surface changes no distance to it.
    """
    skins = np.array([patient.moved_skin(displacement) for displacement in displacements])
    mean = skins.mean(axis=0)
    normals = vertex_normals(mean, patient.skin_faces)
    return np.einsum("ksx,sx->ks", skins - mean, normals).std(axis=0, ddof=1)


def usual_spreads(patients: Sequence[tuple[np.ndarray, np.ndarray]]) -> np.ndarray:
    """Root mean square (r,) of the spread in every region of NAMES, patients weighing equally; NaN where nobody has it.

    patients: skin_spread (s,) and region (s,) of each.
    """
    squares = np.full((len(patients), len(NAMES)), np.nan)
    for row, (spread, region) in enumerate(patients):
        for code in np.unique(region[region >= 0]):
            squares[row, code] = np.mean(spread[region == code] ** 2)
    known = np.isfinite(squares)
    return np.sqrt(np.where(known, squares, 0).sum(axis=0) / np.where(known.any(axis=0), known.sum(axis=0), np.nan))


def interval(patient: PatientModel, displacements, calibration: Calibration, region=None) -> Interval:
    """The interval of a patient whom no fold model has seen, from their displacements (k, n, 3) mm.

    region (s,): regions(patient), which serve every plan; they are made where it is None.

    The half-width is the region's q, and sqrt(q^2 + z^2 (spread^2 - usual^2)) where the models disagree more than
    usual: were a model's error the sum of one that all share and a normal one of its own, its variance would grow by
    just this; z is the normal quantile that belongs to the level [I]. So it is never narrower than q.

    Only q is calibrated. The widening cannot be: of each patient of the cohort all models but one have seen the
    outcome. They agree better on these, so the usual spread is low, and an interval rather too wide than too narrow.
    Nor is the mean of the models what q was calibrated on, which is one model; on average it errs no more than one
    where the outcome is flat over their spread.

    InputError where nothing is calibrated.
    """
    displacements = np.asarray(displacements, float)
    region = regions(patient) if region is None else region
    q, usual = (
        replace(calibration, half_width=each).by_region for each in (calibration.half_width, calibration.usual_spread)
    )
    if not np.isfinite(q[region]).any():
        raise InputError(
            "-",
            "calibration",
            f"{calibration.patients} patients are too few for a level of {calibration.level}",
            "lower uncertainty.level, or scan more patients",
        )
    z = ndtri(0.5 + calibration.level / 2)
    excess = np.zeros(len(region))  # one model agrees with itself
    if len(displacements) > 1:
        excess = np.maximum(skin_spread(patient, displacements) ** 2 - usual[region] ** 2, 0)
    mean = displacements.mean(axis=0)
    spread = np.sqrt(np.sum((displacements - mean) ** 2, axis=2).mean(axis=0))
    return Interval(mean, spread, np.sqrt(q[region] ** 2 + z**2 * excess), region)


def widened(result: Interval, factor: float) -> Interval:
    """The interval of a plan that lies beyond those it was calibrated on, `factor` times as wide."""
    return replace(result, half_width=factor * result.half_width)


def repaired_interval(
    patient: PatientModel, displacements, calibration: Calibration, fem: FemSettings, region=None
) -> tuple[Interval, Repair]:
    """The interval of :func:`interval` with no element of the mean field inverted, and what that took."""
    raw = interval(patient, displacements, calibration, region)
    mesh, constrained = (patient.points, patient.cells, fem.material(patient.tissue)), patient.node_type != FREE
    displacement, repair = repair_inversions(*mesh, raw.displacement, constrained, fem.volumetric)
    return replace(raw, displacement=displacement), repair
