"""What is wished of a face: places of landmarks, a surface, measures; each with a weight."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy import sparse

from pinnochio.geometry.closest_points import closest_points
from pinnochio.geometry.triangles import vertex_areas, vertex_normals
from pinnochio.model.landmarks import FaceLandmarks
from pinnochio.model.patient import PatientModel

STEP = 1e-3  # mm, of the differences that linearise a measure


@dataclass(frozen=True)
class Marks:
    """Points of a skin that go with it: names, nodes (l, 3) and weights (l, 3) of the skin points that carry each,
    rest (l, 3) mm where they are before, a little off the skin if they were marked so."""

    names: tuple[str, ...]
    nodes: np.ndarray
    weights: np.ndarray
    rest: np.ndarray

    @classmethod
    def on(cls, model: PatientModel, points: Mapping[str, np.ndarray]) -> "Marks":
        """The points (3,) mm, each carried by the triangle of the skin that is nearest to it."""
        rest = np.array(list(points.values()), float).reshape(-1, 3)
        at = closest_points(rest, model.skin_points, model.skin_faces)
        weights = at.weights(model.skin_points, model.skin_faces)
        return cls(tuple(points), model.skin_faces[at.face].reshape(-1, 3), weights, rest)

    def moved(self, displacement: np.ndarray) -> np.ndarray:
        """Places (l, 3) mm under a displacement (s, 3) mm of the skin."""
        return self.rest + np.einsum("lc,lcx->lx", self.weights, displacement[self.nodes])

    def rows(self, index: int, points: int) -> sparse.csr_array:
        """Derivative (3, 3 s) of the place of one mark by the displacements of so many skin points."""
        columns = (3 * self.nodes[index][:, None] + np.arange(3)).ravel()
        values = np.repeat(self.weights[index], 3)
        return sparse.csr_array((values, (np.tile(np.arange(3), 3), columns)), shape=(3, 3 * points))


def named(landmarks: FaceLandmarks) -> dict[str, np.ndarray]:
    """Place (3,) mm of every landmark by its name; those of both sides with the side."""
    points = {}
    for name, place in vars(landmarks).items():
        points |= {name: place} if place.ndim == 1 else {f"{name}_right": place[0], f"{name}_left": place[1]}
    return points


@dataclass(frozen=True)
class PlaceWish:
    """A mark (`index` of marks) shall go to target (3,) mm."""

    name: str
    marks: Marks
    index: int
    target: np.ndarray
    weight: float
    unit: str = "mm"

    def rows(self, model: PatientModel, displacement: np.ndarray) -> tuple[np.ndarray, sparse.csr_array]:
        """Residual (m,) and its derivative (m, 3 s) by the displacement (s, 3) mm of the skin."""
        return self._off(displacement), self.marks.rows(self.index, len(displacement))

    def error(self, model: PatientModel, displacement: np.ndarray) -> float:
        """How far the wish is missed, in its unit."""
        return float(np.linalg.norm(self._off(displacement)))

    def asked(self, model: PatientModel) -> float:
        """How far it is missed before surgery."""
        return float(np.linalg.norm(self.marks.rest[self.index] - self.target))

    def _off(self, displacement):
        return self.marks.moved(displacement)[self.index] - self.target


@dataclass(frozen=True)
class SurfaceWish:
    """The judged face, or the part that lies over the surface, shall lie on points (p, 3) mm, faces (f, 3).

    normals (p, 3) of the surface.
    """

    name: str
    points: np.ndarray
    faces: np.ndarray
    normals: np.ndarray
    weight: float
    unit: str = "mm"

    @classmethod
    def of(cls, name: str, points, faces, weight: float = 1.0) -> "SurfaceWish":
        return cls(name, np.asarray(points, float), np.asarray(faces), vertex_normals(points, faces), weight)

    def rows(self, model: PatientModel, displacement: np.ndarray) -> tuple[np.ndarray, sparse.csr_array]:
        """Distances (m,) along the surface's normals, each by the root of its share of the face; their derivative."""
        judged, off, normals, share = self._off(model, displacement)
        scale = np.sqrt(share)
        columns = 3 * judged[:, None] + np.arange(3)
        values = normals * scale[:, None]
        place = np.repeat(np.arange(len(judged)), 3)
        derivative = sparse.csr_array(
            (values.ravel(), (place, columns.ravel())), shape=(len(judged), 3 * len(model.skin_points))
        )
        return off * scale, derivative

    def error(self, model: PatientModel, displacement: np.ndarray) -> float:
        """Root mean square distance along the normals, mm."""
        _, off, _, share = self._off(model, displacement)
        return float(np.sqrt(share @ off**2))

    def asked(self, model: PatientModel) -> float:
        return self.error(model, np.zeros_like(model.skin_points))

    def distances(self, model: PatientModel, displacement: np.ndarray) -> np.ndarray:
        """Signed distance (s,) mm of the face from the wish, positive in front of it; NaN where nothing is wished."""
        judged, off, _, _ = self._off(model, displacement)
        own = np.full(len(model.skin_points), np.nan)
        own[judged] = off
        return own

    def _off(self, model, displacement):
        """Skin points (k,) over the surface, distance (k,), normal (k, 3) and share (k,) of the area of each."""
        judged = model.judged_points
        moved = model.skin_points[judged] + displacement[judged]
        at = closest_points(moved, self.points, self.faces)
        over = ~at.border
        weights = at.weights(self.points, self.faces)[over]
        normals = np.einsum("kc,kcx->kx", weights, self.normals[self.faces[at.face[over]]])
        normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
        area = vertex_areas(model.skin_points, model.skin_faces)[judged[over]]
        off = np.einsum("kx,kx->k", moved[over] - at.points[over], normals)
        return judged[over], off, normals, area / max(area.sum(), 1e-12)


@dataclass(frozen=True)
class MeasureWish:
    """A measure of the marks' places, `of` (l, 3) mm, shall be `target`; one unit counts as one mm."""

    name: str
    marks: Marks
    of: Callable[[np.ndarray], float]
    target: float
    weight: float
    unit: str = "mm"

    def rows(self, model: PatientModel, displacement: np.ndarray) -> tuple[np.ndarray, sparse.csr_array]:
        """Residual (1,) and its derivative (1, 3 s) by the displacement (s, 3) mm of the skin."""
        places = self.marks.moved(displacement)
        derivative = sparse.csr_array((1, 3 * len(displacement)))
        for index in range(len(places)):
            slope = np.zeros(3)
            for axis in range(3):
                ahead, behind = places.copy(), places.copy()
                ahead[index, axis] += STEP
                behind[index, axis] -= STEP
                slope[axis] = (self.of(ahead) - self.of(behind)) / (2 * STEP)
            if slope.any():
                derivative = derivative + sparse.csr_array(slope[None]) @ self.marks.rows(index, len(displacement))
        return np.array([self.of(places) - self.target]), derivative

    def error(self, model: PatientModel, displacement: np.ndarray) -> float:
        """How far the wish is missed, in its unit."""
        return abs(self.of(self.marks.moved(displacement)) - self.target)

    def asked(self, model: PatientModel) -> float:
        return abs(self.of(self.marks.rest) - self.target)


Wish = Sequence[PlaceWish | SurfaceWish | MeasureWish]


def stacked(wish: Wish, model: PatientModel, displacement: np.ndarray) -> tuple[np.ndarray, sparse.csr_array]:
    """Residuals (m,) of all wishes and their derivative (m, 3 s); their squares add up to the weighted mean of the
    wishes' squared errors."""
    total = sum(own.weight for own in wish)
    parts = [(own, *own.rows(model, displacement)) for own in wish]
    scales = [np.sqrt(own.weight / total) for own, _, _ in parts]
    residual = np.concatenate([scale * off for scale, (_, off, _) in zip(scales, parts, strict=True)])
    return residual, sparse.vstack([scale * rows for scale, (_, _, rows) in zip(scales, parts, strict=True)], "csr")
