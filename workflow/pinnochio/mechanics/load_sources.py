"""Sources: loads on the soft tissue by which a learned method says what bone motion does not explain.

A load that acts on the tissue changes its shape as mechanics lets it, so whatever is learned, the field that answers is
in equilibrium with the declared load. Pressure and traction on the skin stand for what swells, thins, unfurls, sags or
is pulled there.
"""

import weakref
from functools import cached_property

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from pinnochio.geometry.triangles import vertex_normals
from pinnochio.mechanics.boundary.conditions import boundary_conditions
from pinnochio.mechanics.settings import FemSettings
from pinnochio.mechanics.solvers.linear_elasticity import ElasticSolver
from pinnochio.model.face_modes import FaceModes
from pinnochio.model.patient import PatientModel
from pinnochio.plans.plan import Plan

SMOOTH = 1e-3  # of the mean response: what answers less is not brought to its place by a large load [X]
BROAD = 20, 10  # symmetric and antisymmetric patterns of traction: more bring the face hardly nearer [X]


class AnsweringTissue:
    """A patient's elastic response, sliding nodes free to slide: to a plan, and to loads that bring the judged face to
    where it is wanted; made once for all of both."""

    def __init__(self, model: PatientModel, fem: FemSettings):
        self._model, rest = model, boundary_conditions(model, Plan("-", {}), "mucosa")
        self._onto, law = model.onto_judged, fem.material(model.tissue)
        self._solver = ElasticSolver(model.points, model.cells, law, rest, fem.volumetric)
        weakref.finalize(self, self._solver.close)

    def follows(self, plan: Plan) -> np.ndarray:
        """Displacement (k, 3) mm of the points of the judged face under a plan, to first order."""
        return self._onto @ self._solver.solve(boundary_conditions(self._model, plan, "mucosa"))

    def answer(self, wanted: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Force (n, 3) mN that moves the points of the judged face by `wanted` (k, 3) mm as nearly as the tissue lets
        it, and the displacement (n, 3) mm that answers it, to first order. Least squares, in which loads count too, so
        that where tissue hardly answers they stay below 0.5 / sqrt(SMOOTH) times the usual one."""
        loads, fields, shown, square = self._responses
        amounts = cho_solve(square, shown @ wanted.ravel())
        return np.tensordot(amounts, loads, 1), np.tensordot(amounts, fields, 1)

    @cached_property
    def _responses(self) -> tuple:
        """Loads (l, n, 3) mN by smooth patterns of the face, of pressure and, the broadest, of traction along each
        axis; fields (l, n, 3) mm that answer them; what each does to the face times area (l, 3k); their squares with
        the penalty, factorised. InputError where the face cannot be read."""
        model, face = self._model, self._model.judged_points
        area = model.judged_areas
        normals = vertex_normals(model.skin_points, model.skin_faces)[face]
        modes = FaceModes.of([model])
        patterns = modes(model) * area[:, None]
        broadest = np.hstack([part[:, :n] for part, n in zip(modes.halves(patterns), BROAD, strict=True)])
        broad = np.einsum("kq,xy->kqxy", broadest, np.eye(3)).reshape(len(face), -1, 3)
        per_point = np.concatenate([np.einsum("kq,kx->kqx", patterns, normals), broad], axis=1)
        loads = (self._onto.T @ per_point.reshape(len(face), -1)).reshape(len(model.points), -1, 3).transpose(1, 0, 2)
        fields = self._solver.under(loads)
        moved = np.stack([self._onto @ field for field in fields]).reshape(len(fields), -1)
        shown = moved * np.repeat(area, 3)
        square = shown @ moved.T
        square += SMOOTH * np.trace(square) / len(square) * np.eye(len(square))
        return loads, fields, shown, cho_factor(square)
