"""Sources: loads on the soft tissue by which a learned method says what bone motion does not explain.

A load that acts on the tissue changes its shape as mechanics lets it, so whatever amplitudes are learned, the field
that answers them is in equilibrium with the declared load. Pressure under the skin, about anchors of the face, stands
for what swells, thins, unfurls or is pulled there; the weight of the tissue, which turns when a patient who was scanned
lying sits up, is a source of its own.
"""

from dataclasses import dataclass

import numpy as np

from pinnochio.geometry.triangles import vertex_areas, vertex_normals
from pinnochio.mechanics.boundary.conditions import boundary_conditions
from pinnochio.mechanics.elements.materials import Material
from pinnochio.mechanics.elements.tetrahedra import VOLUMETRIC, node_volumes
from pinnochio.mechanics.solvers.linear_elasticity import ElasticSolver
from pinnochio.model.patient import PatientModel
from pinnochio.plans.plan import Plan

REACH = 8.0  # mm, SD of the pressure about an anchor: half the way between anchors [I]
LEAST = 1e-3  # of the pressure's peak: no load beyond
WEIGHT = 9.81e-3  # mN/mm3, tissue of 1 g/cm3 [R]
SITTING_UP = np.array([0.0, -1.0, -1.0])  # down when upright less down when lying on the back, LPS
DAMPING = 0.2  # of the mean response at its own anchor: what answers less is not brought up to a unit [I]


@dataclass(frozen=True)
class Sources:
    """Loads on one patient's mesh and what each does to it, to first order.

    forces (a + 1, n, 3) mN of unit amplitudes and fields (a + 1, n, 3) mm that answer them, sliding nodes free to
    slide. The unit of each of a anchors moves the skin there by about 1 mm outwards, and at the other anchors hardly;
    the last is the change of the tissue's weight from lying to upright.
    """

    forces: np.ndarray
    fields: np.ndarray

    def load(self, amplitudes) -> np.ndarray:
        """Force (n, 3) mN of amplitudes (a + 1,)."""
        return np.tensordot(amplitudes, self.forces, 1)

    def field(self, amplitudes) -> np.ndarray:
        """Displacement (n, 3) mm under it, to first order."""
        return np.tensordot(amplitudes, self.fields, 1)


def make_sources(
    model: PatientModel, material: Material, anchors: np.ndarray, volumetric: str = VOLUMETRIC[0]
) -> Sources:
    """The sources of a patient for anchors (a,), skin points of the face."""
    normals = vertex_normals(model.skin_points, model.skin_faces)
    areas = vertex_areas(model.skin_points, model.skin_faces)
    pressures = np.stack([_pressure(model, anchor, areas, normals) for anchor in anchors])
    weight = WEIGHT * node_volumes(model.points, model.cells)[:, None] * SITTING_UP
    boundary = boundary_conditions(model, Plan("-", {}), "mucosa")
    solver = ElasticSolver(model.points, model.cells, material, boundary, volumetric)
    forces = np.concatenate([pressures, weight[None]])
    fields = solver.under(forces)
    solver.close()

    outward = np.einsum("qax,ax->qa", _skin(model, fields[:-1], anchors), normals[anchors])
    unit = units(outward)
    for each in (forces, fields):
        each[:-1] = np.tensordot(unit, each[:-1], 1)
    return Sources(forces, fields)


def units(outward: np.ndarray) -> np.ndarray:
    """Which pressures make one source (a, a), from what each pressure does at each anchor (a, a) mm outwards.

    Least squares to 1 mm at one anchor and none at the others, with a penalty: no anchor moves by more than 1 mm.
    """
    penalty = (DAMPING * np.diag(outward).mean()) ** 2
    return np.linalg.solve(outward @ outward.T + penalty * np.eye(len(outward)), outward).T


def _pressure(model: PatientModel, anchor: int, areas: np.ndarray, normals: np.ndarray) -> np.ndarray:
    """Force (n, 3) mN on the nodes under the skin about an anchor, outwards, 1 N in all."""
    share = np.exp(-0.5 * ((model.skin_points - model.skin_points[anchor]) ** 2).sum(1) / REACH**2)
    share = np.where(share < LEAST, 0, share) * areas
    force = np.zeros_like(model.points)
    loaded = np.flatnonzero(share)
    push = 1000 * (share[loaded] / share.sum())[:, None] * normals[loaded]
    np.add.at(force, model.skin_nodes[loaded], model.skin_weights[loaded][..., None] * push[:, None])
    return force


def _skin(model: PatientModel, fields: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Displacement (q, k, 3) mm of skin points (k,) under fields (q, n, 3) mm."""
    return np.einsum("kc,qkcx->qkx", model.skin_weights[points], fields[:, model.skin_nodes[points]])
