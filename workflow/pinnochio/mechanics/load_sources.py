"""Sources: loads on the soft tissue by which a learned method says what bone motion does not explain.

A load that acts on the tissue changes its shape as mechanics lets it, so whatever amplitudes are learned, the field
that answers them is in equilibrium with the declared load. Pressure under the skin stands for what swells, thins,
unfurls, sags or is pulled there.
"""

import weakref
from dataclasses import dataclass

import numpy as np

from pinnochio.geometry.triangles import vertex_areas, vertex_normals
from pinnochio.mechanics.boundary.conditions import boundary_conditions
from pinnochio.mechanics.settings import FemSettings
from pinnochio.mechanics.solvers.linear_elasticity import ElasticSolver
from pinnochio.model.patient import PatientModel
from pinnochio.plans.plan import Plan

SMOOTH = 1e-3  # of the mean response: what answers less is not brought up to its pattern by a large load [X]


@dataclass(frozen=True)
class Sources:
    """Loads on one patient's mesh and what each does to it, to first order.

    mixed (p, q): how much of the forces (p, n, 3) mN, and of the fields (p, n, 3) mm that answer them, sliding nodes
    free to slide, unit amplitudes are: the judged skin moves outwards by one pattern each, in mm, as nearly as the
    tissue lets it. outward (k, q) mm: by how much each does.
    """

    mixed: np.ndarray
    forces: np.ndarray
    fields: np.ndarray
    outward: np.ndarray

    def load(self, amplitudes) -> np.ndarray:
        """Force (n, 3) mN of amplitudes (q,)."""
        return np.tensordot(self.mixed @ amplitudes, self.forces, 1)

    def field(self, amplitudes) -> np.ndarray:
        """Displacement (n, 3) mm under it, to first order."""
        return np.tensordot(self.mixed @ amplitudes, self.fields, 1)


class AnsweringTissue:
    """A patient's elastic response to pressure under the judged face, factorised once for any patterns."""

    def __init__(self, model: PatientModel, fem: FemSettings):
        self._model, boundary = model, boundary_conditions(model, Plan("-", {}), "mucosa")
        law = fem.material(model.tissue)
        self._solver = ElasticSolver(model.points, model.cells, law, boundary, fem.volumetric)
        weakref.finalize(self, self._solver.close)

    def __call__(self, patterns: np.ndarray) -> Sources:
        """The sources for patterns (k, q) over the points of the judged face: pressures of the same patterns under the
        skin, mixed so that what the response makes of them are the patterns again."""
        model, face = self._model, self._model.judged_points
        normals = vertex_normals(model.skin_points, model.skin_faces)[face]
        area = vertex_areas(model.skin_points, model.skin_faces[model.face_roi])[face]
        pressed = np.einsum("kq,k,kx->kqx", patterns, area, normals).reshape(len(face), -1)
        onto = model.onto_judged
        forces = (onto.T @ pressed).reshape(len(model.points), -1, 3).transpose(1, 0, 2)
        fields = self._solver.under(forces)
        shown = (onto @ fields.transpose(1, 0, 2).reshape(len(model.points), -1)).reshape(len(face), -1, 3)
        outward = np.einsum("kqx,kx->kq", shown, normals)
        mixed = units(outward, patterns, area)
        return Sources(mixed, forces, fields, outward @ mixed)


def units(outward: np.ndarray, patterns: np.ndarray, area: np.ndarray) -> np.ndarray:
    """Which loads make one pattern (p, q), from what each load does (k, p) mm, by areas (k,): least squares, in which
    loads count too, so that where tissue hardly answers they stay below 0.5 / sqrt(SMOOTH) times the usual one."""
    square = (outward.T * area) @ outward
    penalty = SMOOTH * np.trace(square) / len(square) * np.eye(len(square))
    return np.linalg.solve(square + penalty, (outward.T * area) @ patterns)
