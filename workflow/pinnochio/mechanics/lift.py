"""The lift: linear maps, made once per patient, that carry any motion of the bone through the tissue at once."""

import os
import time
from dataclasses import dataclass, fields

import numpy as np

from pinnochio.geometry.scattered import farthest
from pinnochio.hdf5 import reading, writing
from pinnochio.mechanics.boundary.conditions import BoundaryConditions, boundary_conditions
from pinnochio.mechanics.elements.materials import Material
from pinnochio.mechanics.elements.tetrahedra import VOLUMETRIC
from pinnochio.mechanics.solvers.linear_elasticity import ElasticSolver
from pinnochio.model.patient import FREE, MOVING, NO_INTERFACE, SLIDING, PatientModel
from pinnochio.plans.plan import Plan

BATCH = 32  # right-hand sides solved together


@dataclass(frozen=True)
class Lift:
    """Displacement fields of a patient's mesh that are linear in the motion of its interface.

    motions (12 K, n, 3): mm per unit of the affine motion of each of K segments (:func:`motion_amplitudes`), the
    sliding nodes free to slide; contact (i,) nodes in contact with bone; smoothing (q, i): amplitudes of q control
    points for a displacement of the contact nodes; departures (3 q, n, 3): fields of unit amplitudes of the control
    points in x, y, z, every contact node prescribed, cut planes at rest. All float32. seconds: what making it took.
    """

    motions: np.ndarray
    contact: np.ndarray
    smoothing: np.ndarray
    departures: np.ndarray
    centre: np.ndarray
    seconds: float = 0.0

    def write(self, path: str | os.PathLike) -> None:
        """Write the lift as HDF5."""
        with writing(path) as file:
            for item in fields(self):
                if item.name == "seconds":
                    file.attrs[item.name] = self.seconds
                else:
                    file.create_dataset(item.name, data=getattr(self, item.name), track_times=False)

    @classmethod
    def read(cls, path: str | os.PathLike) -> "Lift":
        """Read what :meth:`write` wrote."""
        with reading(path) as file:
            arrays = {item.name: file[item.name][()] for item in fields(cls) if item.name != "seconds"}
            return cls(**arrays, seconds=float(file.attrs["seconds"]))


def make_lift(model: PatientModel, material: Material, controls: int, volumetric: str = VOLUMETRIC[0]) -> Lift:
    """The lift of a patient: equilibrium of linear elasticity with the material at rest; sliding nodes keep their
    distance to the bone and are free along it. controls: number of control points spread over the contact.
    """
    began = time.perf_counter()
    centre = model.points.mean(axis=0)
    contact = np.flatnonzero((model.node_type != FREE) & (model.interface_kind != NO_INTERFACE))
    weights = control_weights(model.points[contact], controls)
    gram = weights.T @ weights
    smoothing = np.linalg.solve(gram + 1e-3 * np.trace(gram) / len(gram) * np.eye(len(gram)), weights.T)
    nodes = np.flatnonzero(model.node_type != FREE)
    sliding = boundary_conditions(model, Plan("-", {}), "mucosa")
    free_to_slide = ElasticSolver(model.points, model.cells, material, sliding, volumetric)
    motions = free_to_slide.spread(segment_motions(model, centre))
    free_to_slide.close()
    prescribed = BoundaryConditions(nodes, np.zeros((len(nodes), 3)))
    solver = ElasticSolver(model.points, model.cells, material, prescribed, volumetric)
    departures = np.zeros((3 * weights.shape[1], *model.points.shape), np.float32)
    for first in range(0, len(departures), BATCH):
        rows = np.arange(first, min(first + BATCH, len(departures)))
        unit = np.zeros((len(rows), *model.points.shape))
        for place, row in enumerate(rows):
            unit[place, contact, row % 3] = weights[:, row // 3]
        departures[rows] = solver.spread(unit)
    solver.close()
    return Lift(
        motions=np.asarray(motions, np.float32),
        contact=contact,
        smoothing=np.asarray(smoothing, np.float32),
        departures=departures,
        centre=centre,
        seconds=time.perf_counter() - began,
    )


def motion_amplitudes(plan: Plan, segments: tuple[str, ...], centre: np.ndarray) -> np.ndarray:
    """Amplitudes (12 K,) of `Lift.motions` under a plan: R - I by rows, then the displacement of `centre` in mm."""
    motions = [plan.motion(name) for name in segments]
    parts = [[(m.rotation - np.eye(3)).ravel(), m.displacement(centre[None])[0]] for m in motions]
    return np.concatenate([np.zeros(0), *(part for pair in parts for part in pair)])


def segment_motions(model: PatientModel, centre: np.ndarray) -> np.ndarray:
    """Displacement (12 K, n, 3) mm of the constrained nodes under each unit motion of each segment."""
    share = node_shares(model, (MOVING, SLIDING))
    arm = np.column_stack([model.points - centre, np.ones(len(model.points))])
    motions = np.zeros((len(model.segments), 12, *model.points.shape))
    for row in range(3):
        for column in range(4):
            # Rows of R - I act on the arm; the last column is the displacement of the centre.
            place = 3 * row + column if column < 3 else 9 + row
            motions[:, place, :, row] = share.T * arm[:, column]
    return motions.reshape(-1, *model.points.shape)


def node_shares(model: PatientModel, types: tuple[int, ...]) -> np.ndarray:
    """Share (n, K) of each segment in the motion of each node: one for nodes of these types, else zero."""
    share = (np.arange(len(model.segments)) == model.node_segment[:, None]).astype(float)
    share[~np.isin(model.node_type, types)] = 0
    return share


def control_weights(points: np.ndarray, controls: int) -> np.ndarray:
    """Smooth interpolation (i, q) from q control points, spread evenly over `points` (i, 3) mm, to all of them.

    Gaussians as wide as the control points are apart, rows adding up to one.
    """
    chosen = farthest(points, controls)
    squared = ((points[:, None] - points[chosen]) ** 2).sum(axis=2)
    nearest = np.sqrt(np.sort(squared[chosen], axis=1)[:, 1:2]) if len(chosen) > 1 else np.ones((1, 1))
    weights = np.exp(-squared / (2 * np.median(nearest) ** 2))
    return weights / weights.sum(axis=1, keepdims=True)
