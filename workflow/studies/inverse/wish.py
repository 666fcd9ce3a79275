"""What is wished of a face: places of landmarks, a surface, measures; each with a weight."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy import sparse
from scipy.spatial import cKDTree

from pinnochio.geometry.closest_points import closest_points
from pinnochio.geometry.triangles import vertex_areas, vertex_normals
from pinnochio.model.carried import carried_landmarks, carriers
from pinnochio.model.landmarks import face_landmarks
from pinnochio.model.measures import LANDMARKS, Measure
from pinnochio.model.patient import PatientModel
from pinnochio.model.regions import NAMES, NOT_JUDGED, regions


@dataclass(frozen=True)
class Marks:
    """Points of a patient's tissue: rest (l, 3) mm where they are before; carriers (l, n): weights of the nodes whose
    displacement each takes, as in :mod:`pinnochio.model.carried`."""

    names: tuple[str, ...]
    rest: np.ndarray
    carriers: sparse.csr_array

    @classmethod
    def of(cls, model: PatientModel, more: Mapping[str, np.ndarray] | None = None) -> "Marks":
        """The landmarks of the face that are known, and `more` points (3,) mm of its skin by name, which go before."""
        marks = face_landmarks(model)
        carried = carried_landmarks(model)
        known = np.isfinite(carried.positions).all(axis=1) & ~np.isin(LANDMARKS, list(more or {}))
        beside = {"stomion": marks.stomion, "cheilion_right": marks.cheilion[0], "cheilion_left": marks.cheilion[1]}
        beside |= more or {}
        return cls(
            (*np.array(LANDMARKS)[known].tolist(), *beside),
            np.vstack([carried.positions[known], *beside.values()]),
            sparse.vstack([carried.carriers[known], *(carriers(model, place) for place in beside.values())], "csr"),
        )

    def chosen(self, names: Sequence[str]) -> "Marks":
        """These of them, in this order."""
        rows = [self.names.index(name) for name in names]
        return Marks(tuple(names), self.rest[rows], self.carriers[rows])

    def moved(self, field: np.ndarray) -> np.ndarray:
        """Places (l, 3) mm under a displacement (n, 3) mm of the mesh."""
        return self.rest + self.carriers @ field

    @property
    def rows(self) -> sparse.csr_array:
        """Derivative (3 l, 3 n) of the places by the displacement."""
        return sparse.kron(self.carriers, sparse.eye_array(3), "csr")


@dataclass(frozen=True)
class PlaceWish:
    """The one mark shall go to target (3,) mm."""

    name: str
    mark: Marks
    target: np.ndarray
    weight: float
    unit: str = "mm"

    def rows(self, field: np.ndarray) -> tuple[np.ndarray, sparse.csr_array]:
        """Residual (3,) and its derivative (3, 3 n) by the displacement (n, 3) mm of the mesh."""
        return self.mark.moved(field)[0] - self.target, self.mark.rows

    def error(self, field: np.ndarray) -> float:
        """How far the wish is missed, in its unit."""
        return float(np.linalg.norm(self.mark.moved(field)[0] - self.target))


@dataclass(frozen=True)
class MeasureWish:
    """A measure of the marks that it reads shall be `target`; one degree counts as one mm."""

    name: str
    marks: Marks
    measure: Measure
    target: float
    weight: float

    @property
    def unit(self) -> str:
        return self.measure.unit

    def value(self, field: np.ndarray) -> float:
        """The measure under a displacement (n, 3) mm of the mesh."""
        return self.measure.rule(self.marks.moved(field))[0]

    def rows(self, field: np.ndarray) -> tuple[np.ndarray, sparse.csr_array]:
        """Residual (1,) and its derivative (1, 3 n) by the displacement (n, 3) mm of the mesh."""
        value, slope = self.measure.rule(self.marks.moved(field))
        return np.array([value - self.target]), sparse.csr_array(slope.reshape(1, -1)) @ self.marks.rows

    def error(self, field: np.ndarray) -> float:
        """How far the wish is missed, in its unit."""
        return abs(self.value(field) - self.target)


@dataclass(frozen=True)
class SurfaceWish:
    """The judged face of the model, or the part of it that lies over the surface, shall lie on points (p, 3) mm,
    faces (f, 3). normals (p, 3) of the surface; areas (s,) of the model's skin points."""

    name: str
    model: PatientModel
    points: np.ndarray
    faces: np.ndarray
    normals: np.ndarray
    areas: np.ndarray
    weight: float
    unit: str = "mm"

    @classmethod
    def of(cls, name: str, model: PatientModel, points, faces, weight: float = 1.0) -> "SurfaceWish":
        """A surface of points (p, 3) mm, faces (f, 3), its outer side in front."""
        areas = vertex_areas(model.skin_points, model.skin_faces)
        return cls(
            name, model, np.asarray(points, float), np.asarray(faces), vertex_normals(points, faces), areas, weight
        )

    def rows(self, field: np.ndarray) -> tuple[np.ndarray, sparse.csr_array]:
        """Distances (m,) along the surface's normals, each by the root of its share of the face, and their derivative
        (m, 3 n) by the displacement (n, 3) mm of the mesh."""
        over, off, normals, share = self._off(field)
        scale = np.sqrt(share)
        nodes, weights = self.model.skin_nodes[over], self.model.skin_weights[over]
        values = (scale[:, None] * weights)[:, :, None] * normals[:, None]
        columns = 3 * nodes[:, :, None] + np.arange(3)
        place = np.repeat(np.arange(len(over)), 9)
        shape = len(over), 3 * len(self.model.points)
        return off * scale, sparse.coo_array((values.ravel(), (place, columns.ravel())), shape=shape).tocsr()

    def error(self, field: np.ndarray) -> float:
        """Root mean square distance along the normals, mm."""
        _, off, _, share = self._off(field)
        return float(np.sqrt(share @ off**2))

    def distances(self, field: np.ndarray) -> np.ndarray:
        """Signed distance (s,) mm of the face from the wish, positive in front of it; NaN where nothing is wished."""
        over, off, _, _ = self._off(field)
        distances = np.full(len(self.model.skin_points), np.nan)
        distances[over] = off
        return distances

    def _off(self, field):
        """Skin points (k,) over the surface, distance (k,), normal (k, 3) and share (k,) of the area of each."""
        judged = self.model.judged_points
        moved = self.model.moved_skin(field)[judged]
        at = closest_points(moved, self.points, self.faces)
        over = ~at.border
        weights = at.weights[over]
        normals = np.einsum("kc,kcx->kx", weights, self.normals[self.faces[at.face[over]]])
        normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
        area = self.areas[judged[over]]
        off = np.einsum("kx,kx->k", moved[over] - at.points[over], normals)
        return judged[over], off, normals, area / max(area.sum(), 1e-12)


def regions_of(wish: "Wish", model: PatientModel) -> dict[str, str]:
    """The region of the face (of regions.NAMES) in which each wished landmark lies, where it is judged."""
    codes, tree = regions(model), cKDTree(model.skin_points)
    names = {}
    for item in wish:
        if isinstance(item, PlaceWish):
            code = codes[tree.query(item.mark.rest[0])[1]]
            names |= {item.name: NAMES[code]} if code != NOT_JUDGED else {}
    return names


Wish = Sequence[PlaceWish | SurfaceWish | MeasureWish]


def stacked(wish: Wish, field: np.ndarray) -> tuple[np.ndarray, sparse.csr_array]:
    """Residuals (m,) of all wishes and their derivative (m, 3 n); their squares add up to the weighted mean of the
    wishes' squared errors."""
    total = sum(item.weight for item in wish)
    parts = [(np.sqrt(item.weight / total), *item.rows(field)) for item in wish]
    residual = np.concatenate([scale * off for scale, off, _ in parts])
    return residual, sparse.vstack([scale * rows for scale, _, rows in parts], "csr")


def misfit(wish: Wish, field: np.ndarray) -> float:
    """Weighted root mean square of the wishes' errors under a displacement (n, 3) mm of the mesh, mm."""
    total = sum(item.weight for item in wish)
    return float(np.sqrt(sum(item.weight * item.error(field) ** 2 for item in wish) / total))
