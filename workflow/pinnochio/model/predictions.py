"""Predicted displacement fields of one fold and method, case by case; those made elsewhere come in here."""

import os
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from scipy.spatial import cKDTree

from pinnochio.errors import refusal
from pinnochio.hdf5 import reading, writing
from pinnochio.model.patient import PatientModel

SAME_PLACE = 1e-3  # mm
FARTHEST = 100.0  # mm; twice as far as a bone is moved
# Of a prediction: datasets of its file, the rest are attributes.
FIELDS = ("displacement", "boundary", "raw", "forces", "skin")


@dataclass(frozen=True)
class Prediction:
    """Displacement (n, 3) mm of every node, with how it came about; None of methods that move the skin alone.

    seconds: one plan, warm, without reading files; setup_seconds: what belongs to the patient and serves every plan;
    NaN where nobody timed them. threads: 0 where unknown. iterations: of a solver, or corrections of a network's field.
    load: share of the plan that a solver has reached.
    boundary (n, 3) mm: where a network puts the interface nodes, which its field need not meet; None of other methods.
    forces (n, 3) mN: the load on the tissue, beside what the bone does, that the field is in equilibrium with, or None.
    raw (n, 3) mm: the network's own field, before repair and corrections; None of other methods. repaired: elements
    that the inversion repair solved again; damping: its factor on the whole field, 1 for none. NaN without repair.
    skin (s, 3) mm: displacement of the skin points, of methods that move nothing else.
    """

    displacement: np.ndarray | None
    seconds: float = 0.0
    setup_seconds: float = 0.0
    threads: int = 1
    device: str = "cpu"
    converged: bool = True
    reason: str = "no solver"
    iterations: int = 0
    load: float = 1.0
    boundary: np.ndarray | None = None
    raw: np.ndarray | None = None
    forces: np.ndarray | None = None
    repaired: float = np.nan
    damping: float = np.nan
    skin: np.ndarray | None = None

    def moved_skin(self, patient: PatientModel) -> np.ndarray:
        """Points of the patient's outer skin (s, 3) mm as predicted."""
        if self.displacement is None:
            return patient.skin_points + self.skin
        return patient.moved_skin(self.displacement)


def write_predictions(path: str | os.PathLike, predictions: Mapping[str, Prediction]) -> None:
    """Write one HDF5 group per case; a key may have parts, as in "V01/3"."""
    with writing(path) as file:
        for case, prediction in predictions.items():
            group = file.create_group(case)
            values = asdict(prediction)
            for name in FIELDS:
                field = values.pop(name)
                if field is not None:
                    group.create_dataset(name, data=field, track_times=False)
            group.attrs.update(values)


def read_prediction(path: str | os.PathLike, case: str) -> Prediction:
    """Read the prediction of one case; InputError where the file does not hold it."""
    with reading(path) as file:
        group = file[case]
        values = {key: value.item() if hasattr(value, "item") else value for key, value in group.attrs.items()}
        return Prediction(**{name: group[name][()] if name in group else None for name in FIELDS}, **values)


def read_external(path: str | os.PathLike, case: str, points: np.ndarray, cells: np.ndarray) -> Prediction:
    """Read a prediction made elsewhere for the patient's own mesh: points (n, 3) mm, cells (m, 4).

    NPZ holds `displacement` (n, 3) mm in the order of the mesh's nodes; VTU the mesh, in any order, with that point
    data. Either may hold `seconds` and `setup_seconds` (VTU: field data). InputError says what does not fit.
    """

    import pyvista as pv  # takes a third of a second, which the jobs that read the study's own files are spared

    refuse = refusal(case, path)
    order = slice(None)
    try:
        if Path(path).suffix == ".npz":
            with np.load(path, allow_pickle=False) as file:
                values = dict(file)
        else:
            grid = pv.read(path)
            values = {**grid.field_data, **grid.point_data}
    except Exception as error:  # whatever NumPy or VTK trips over, it is the file
        refuse(f"it cannot be read ({error})", "write it again")
    if Path(path).suffix == ".vtu":
        order = node_order(grid.points, grid.cells_dict.get(pv.CellType.TETRA), points, cells)
        if order is None:
            refuse(
                f"its {grid.n_points} points are not the {len(points)} nodes of the case's mesh.vtu",
                f"keep the points of that mesh within {SAME_PLACE} mm, and its tetrahedra where the order changes",
            )
    displacement = np.asarray(values.get("displacement"))
    if displacement.dtype.kind not in "fiu":
        refuse("it holds no numbers named 'displacement'", "store one (x, y, z) in mm per node")
    if displacement.shape != points.shape:
        refuse(
            f"displacement is {displacement.shape}, the mesh has {len(points)} nodes",
            "store one (x, y, z) in mm per node",
        )
    if bad := np.count_nonzero(~np.isfinite(displacement).all(axis=1)):
        refuse(f"the displacement of {bad} nodes is not finite", "leave no NaN and no infinity in it")
    if not (farthest := np.abs(displacement).max(initial=0.0)) <= FARTHEST:
        refuse(f"a node is displaced by {farthest:.3g} mm", f"store millimetres; no tissue moves {FARTHEST:.0f} mm")
    times = {name: np.ravel(values.get(name, np.nan)) for name in ("seconds", "setup_seconds")}
    for name, value in times.items():
        if value.dtype.kind not in "fiu" or len(value) != 1 or value[0] < 0:
            refuse(f"{name} is not one number of seconds", "store one that is not negative, or none")
    return Prediction(
        displacement[order].astype(float),
        **{name: float(value[0]) for name, value in times.items()},
        threads=0,
        device="external",
        reason="external",
    )


def node_order(stored_points, stored_cells, points, cells) -> np.ndarray | None:
    """Index (n,) of each node of `points` (n, 3) in `stored_points`; None where the two are not the same nodes.

    Nodes on the two sides of the mouth slit may share a place; the middle of their tetrahedra tells them apart.
    Without tetrahedra the order must be the mesh's, or each node have a place of its own.
    """
    if stored_points.shape != points.shape:
        return None
    stored, wanted = stored_points, points
    if stored_cells is not None and stored_cells.shape == cells.shape:
        stored, wanted = _with_surroundings(stored_points, stored_cells), _with_surroundings(points, cells)
    elif np.abs(stored_points - points).max() <= SAME_PLACE:
        return np.arange(len(points))
    distance, order = cKDTree(stored).query(wanted)
    return order if distance.max() <= SAME_PLACE and len(np.unique(order)) == len(points) else None


def _with_surroundings(points, cells) -> np.ndarray:
    """Each node's place and the mean centre of its tetrahedra, (n, 6) mm."""
    total = np.zeros((len(points), 3))
    np.add.at(total, cells, points[cells].mean(axis=1, keepdims=True))
    count = np.bincount(cells.ravel(), minlength=len(points))
    return np.hstack([points, total / np.maximum(count, 1)[:, None]])
