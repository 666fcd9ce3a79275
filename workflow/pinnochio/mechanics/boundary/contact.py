"""Frictionless contact that opens and closes: nodes of one lip against the other.

A penalty: every contact node s with its area A adds the energy

    E_s = kappa A / 4 min(g, 0)^2,    g = f - min(f at rest, 0),

a half of what a spring of kappa per area has, because each of two surfaces has its nodes in a set against the other; f
its signed distance to the opposing surface. A node that the mesh lays inside the surface starts on it, without
stress; a gap at rest stays a gap, which may close. The pressure kappa |g| pushes along grad f alone: no friction.

f is a moving average over the triangles c of the surface,

    f = sum_c w_c p_c + max(t - h, 0)^2 / 2 R,    w_c = exp(-d_c^2 / h^2) / sum of the same,

of the distances p_c = n_c . (x - m_c) to their planes (IMLS): m_c middle and n_c unit normal of the deformed triangle,
d_c the distance from x to the triangle itself, so that the triangles near x count. t^2 = sum_c w_c (d_c^2 - p_c^2) is
how far x lies beside them: beyond its border the surface is taken to bend away with the radius R, as a lip does. The
triangles of a node are fixed once, those within REACH of it at rest, so that f has no steps, nor its gradient. All of
it is a function of the displacement of the node and of the triangles, the gradient below is exact, and because only
relative places matter, the forces on both sides balance, and their moments.

The tangent is every node's own Hessian, kappa A / 2 (grad f grad f' + g d2f), d2f by central differences. Where
surfaces bend away under pressure it has negative eigenvalues; the definite tangent, sure to descend, is without them.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from pinnochio.errors import InputError
from pinnochio.geometry.triangles import closest_on_triangles, face_normals

# Triangles within it at rest can be touched, mm; what lips slide along each other stays below [I].
REACH = 12.0
FEWEST = 6  # triangles that a node sees at least, however coarse the mesh
WIDTH = 0.25  # h over the square root of the mean area of the triangles
STEP = 1e-4  # mm, of the central differences
NO_WEIGHT = 45.0  # squared distance over h^2, beyond the nearest triangle's, from which a weight is below 1e-19
NEGLIGIBLE = 1e-7  # derivative of f by a node that the tangent leaves out
ROUND = 3.0  # R in mm [I]
STIFFNESS = 200.0  # kappa over mu / edge: in heads of 1,500 to 5,000 nodes 1 kPa enters 0.02-0.04 mm [X]


@dataclass(frozen=True)
class ContactSet:
    """Nodes (s,) with areas (s,) mm2 that may leave a surface but not enter it.

    The surface: faces (f, 3), outward triangles of the same mesh that hold none of the nodes.
    """

    nodes: np.ndarray
    areas: np.ndarray
    faces: np.ndarray


def penalty(modulus: float, edge: float) -> float:
    """Stiffness kappa in kPa/mm for a mesh with the mean shear modulus in kPa and the mean edge in mm."""
    return STIFFNESS * modulus / edge


class UnilateralContact:
    """The contact sets of one mesh, points (n, 3) mm, under a stiffness in kPa/mm.

    pairs (c, 2): node pairs a <= b that the tangent can couple, fixed.
    """

    def __init__(self, points, sets, stiffness: float):
        self.points, self.stiffness = np.asarray(points, float), float(stiffness)
        if not (np.isfinite(self.stiffness) and self.stiffness > 0):
            raise InputError("-", "contact", f"stiffness is {stiffness}", "give a positive one in kPa/mm")
        self.sets = [item for item in sets if len(item.nodes)]
        for item in self.sets:
            _check(item, len(self.points))
        self._sides = [_Faces(item, self.points) for item in self.sets]
        self.nodes = np.concatenate([np.zeros(0, int)] + [np.asarray(item.nodes, int) for item in self.sets])
        self._scale = [self.stiffness / 2 * np.asarray(item.areas, float) for item in self.sets]
        self._levels = [np.minimum(f, 0) for f, _ in self._distances(np.zeros_like(self.points))]
        keys = [_couples(side.stencil, len(self.points))[2] for side in self._sides]
        self._keys = np.unique(np.concatenate([np.zeros(0, int), *map(np.ravel, keys)]))
        self.pairs = np.column_stack(np.divmod(self._keys, len(self.points)))

    def evaluate(self, displacement) -> tuple[float, np.ndarray]:
        """Energy in mN mm and its gradient (n, 3) in mN at a displacement (n, 3) mm."""
        energy, force = 0.0, np.zeros_like(self.points)
        for side, scale, gap, slope in self._gaps(displacement):
            closed = np.minimum(gap, 0)
            energy += 0.5 * float((scale * closed**2).sum())
            row = np.flatnonzero(closed)
            pull = (scale * closed)[row, None, None] * slope[row]
            np.add.at(force, side.stencil[row].ravel(), pull.reshape(-1, 3))
        return energy, force

    def tangent(self, displacement, definite: bool = True) -> tuple[np.ndarray, np.ndarray]:
        """Pairs (k, 2), among `pairs`, and blocks (k, 3, 3) in mN/mm: axis i of node a with axis j of node b.

        definite: every node's Hessian with its negative eigenvalues cut off; else as it is.
        """
        blocks, used = np.zeros((len(self.pairs), 3, 3)), np.zeros(len(self.pairs), bool)
        moved = self.points + displacement
        for side, scale, gap, slope in self._gaps(displacement):
            row = np.flatnonzero(gap < 0)
            if len(row):
                column, hessian = _hessian(side, moved, row, gap[row], slope[row])
                if definite:
                    hessian = _definite(hessian)
                one, two, key = _couples(np.take_along_axis(side.stencil[row], column, axis=1), len(self.points))
                place = np.searchsorted(self._keys, key)
                used[place] = True
                hessian = scale[row, None, None, None] * hessian[np.arange(len(row))[:, None], one, :, two]
                np.add.at(blocks, place, hessian)
        return self.pairs[used], blocks[used]

    def gaps(self, displacement) -> np.ndarray:
        """Gap (s,) in mm at the contact nodes, in the order of `nodes`, negative where one has entered."""
        return np.concatenate([np.zeros(0)] + [side.gap for side in self._gaps(displacement)])

    def _gaps(self, displacement) -> list["_Gap"]:
        """The gaps of every side."""
        distances = self._distances(displacement)
        return [
            _Gap(side, scale, f - level, slope)
            for side, scale, (f, slope), level in zip(self._sides, self._scale, distances, self._levels, strict=True)
        ]

    def _distances(self, displacement) -> list[tuple[np.ndarray, np.ndarray]]:
        moved = self.points + displacement
        return [side.local(moved[side.stencil], np.arange(len(side.stencil))) for side in self._sides]


class _Gap(NamedTuple):
    """Stiffness (s,) mN/mm, gap (s,) mm and its derivative (s, k, 3) by the nodes of a side's stencil."""

    side: "_Faces"
    scale: np.ndarray
    gap: np.ndarray
    slope: np.ndarray


def _hessian(side, moved, row, gap, slope) -> tuple[np.ndarray, np.ndarray]:
    """Hessian (r, c, 3, c, 3) of g^2/2 of some rows (r,) of a side, and the columns (r, c) of the stencil that it is
    of: those that f depends on. gap (r,), slope (r, k, 3)."""
    size = np.abs(slope).max(axis=2)
    count = int((size > NEGLIGIBLE).sum(axis=1).max())
    column = np.argsort(-size, axis=1, kind="stable")[:, :count]
    local, near = moved[side.stencil[row]], np.arange(len(row))[:, None]
    weighty = side.weighty(local, row)
    # All differences of all rows at once: shifted is of shape (r, c, 3, 2, k, 3).
    shifted = np.repeat(local, 6 * count, axis=0).reshape(len(row), count, 3, 2, *local.shape[1:])
    one, at, axis, end = np.ogrid[: len(row), :count, :3, :2]
    shifted[one, at, axis, end, column[one, at], axis] += STEP * (1 - 2 * end)
    each = np.repeat(np.arange(len(row)), 6 * count)
    slopes = side.local(shifted.reshape(-1, *local.shape[1:]), row[each], weighty[each])[1]
    slopes = slopes[np.arange(len(each))[:, None], column[each]].reshape(len(row), count, 3, 2, count, 3)
    curvature = (slopes[:, :, :, 0] - slopes[:, :, :, 1]) / (2 * STEP)
    curvature = (curvature + curvature.transpose(0, 3, 4, 1, 2)) / 2
    slope = slope[near, column]
    return column, slope[:, :, :, None, None] * slope[:, None, None] + gap[:, None, None, None, None] * curvature


def _definite(hessian) -> np.ndarray:
    """Matrices (r, c, 3, c, 3) without their negative eigenvalues."""
    size = 3 * hessian.shape[1]
    values, vectors = np.linalg.eigh(hessian.reshape(-1, size, size))
    kept = (vectors * np.maximum(values, 0)[:, None]) @ vectors.transpose(0, 2, 1)
    return kept.reshape(hessian.shape)


class _Faces:
    """Nodes against triangles of the mesh; a node depends on itself and the corners of its triangles.

    stencil (s, k): the node, then the corners of the triangles near it, then the node again to fill the row.
    """

    def __init__(self, item: ContactSet, points):
        self._nodes, faces = np.asarray(item.nodes, int), np.asarray(item.faces, int)
        self._width = WIDTH * np.sqrt(face_normals(points, faces)[1].mean())
        away, near = cKDTree(points[faces].mean(axis=1)).query(points[self._nodes], len(faces))
        away, near = away.reshape(len(self._nodes), -1), near.reshape(len(self._nodes), -1)
        seen = (away < REACH) | (np.arange(len(faces)) < FEWEST)
        seen, near = seen[:, seen.any(axis=0)], near[:, seen.any(axis=0)]
        self._faces, self._seen = faces[near], seen  # (s, t, 3) corners, (s, t)
        corner_sets = [np.setdiff1d(corners[here], []) for corners, here in zip(self._faces, seen, strict=True)]
        self.stencil = np.repeat(self._nodes[:, None], 1 + max(map(len, corner_sets)), axis=1)
        column = np.zeros(self._faces.shape, int)
        for row, corners in enumerate(corner_sets):
            self.stencil[row, 1 : 1 + len(corners)] = corners
            column[row, seen[row]] = 1 + np.searchsorted(corners, self._faces[row, seen[row]])
        self._column = column  # of the corners in the stencil; unseen triangles have no weight

    def weighty(self, here, row) -> np.ndarray:
        """The triangles (r, w) of some rows, moved points of their stencil (r, k, 3), that have a weight in double
        precision, and others to fill the row."""
        corners = here[np.arange(len(row))[:, None, None], self._column[row]]
        square = (here[:, :1] - np.einsum("stc,stcx->stx", closest_on_triangles(here[:, :1], corners)[1], corners)) ** 2
        square = np.where(self._seen[row], square.sum(axis=2), np.inf)
        count = int((square < square.min(axis=1, keepdims=True) + NO_WEIGHT * self._width**2).sum(axis=1).max())
        return np.argsort(square, axis=1, kind="stable")[:, :count]

    def local(self, here, row, among=None) -> tuple[np.ndarray, np.ndarray]:
        """Signed distance (r,) and its derivative (r, k, 3) of some rows, moved points of their stencil (r, k, 3).

        among (r, w): the triangles of each row to look at; all without it.
        """
        shape, column, seen = here.shape, self._column[row], self._seen[row]
        if among is not None:
            column, seen = np.take_along_axis(column, among[..., None], 1), np.take_along_axis(seen, among, 1)
        column = column + shape[1] * np.arange(shape[0])[:, None, None]
        corners, here = here.reshape(-1, 3)[column], here[:, :1]
        first, second = corners[:, :, 1] - corners[:, :, 0], corners[:, :, 2] - corners[:, :, 0]
        normal = np.cross(first, second)
        length = np.maximum(np.linalg.norm(normal, axis=2, keepdims=True), 1e-12)
        normal = normal / length
        offset = here - corners.mean(axis=2)
        plane = (offset * normal).sum(axis=2)
        shares = closest_on_triangles(here, corners)[1]
        away = here - np.einsum("stc,stcx->stx", shares, corners)
        square = (away**2).sum(axis=2)
        weight = np.where(seen, square, np.inf)
        weight = np.exp((weight.min(axis=1, keepdims=True) - weight) / self._width**2)
        weight /= weight.sum(axis=1, keepdims=True)
        mean = (weight * plane).sum(axis=1, keepdims=True)
        aside = square - plane**2
        beside = (weight * aside).sum(axis=1, keepdims=True)
        out = np.maximum(np.sqrt(np.maximum(beside, 0)) - self._width, 0)
        rise = out / (2 * ROUND * (self._width + out))  # derivative by t^2
        # Derivatives by p_c and d_c^2, the latter in itself and in the weights.
        by_plane = weight * (1 - 2 * rise * plane)
        by_square = weight * (rise - (plane - mean + rise * (aside - beside)) / self._width**2)
        # That the closest point moves along its triangle changes the distance not at all, to first order.
        pull, along = 2 * by_square[..., None] * away, by_plane[..., None] * normal
        # The normal is first x second over its length.
        turn = by_plane[..., None] * (offset - plane[..., None] * normal) / length
        by_second, by_first = np.cross(turn, first), np.cross(second, turn)
        by_corner = np.stack([-by_first - by_second, by_first, by_second], axis=2)
        by_corner -= along[:, :, None] / 3 + shares[..., None] * pull[:, :, None]
        flat = [np.bincount(column.ravel(), by_corner[..., axis].ravel(), shape[0] * shape[1]) for axis in range(3)]
        slope = np.stack(flat, axis=1).reshape(shape)
        slope[:, 0] = (along + pull).sum(axis=1)  # in place of the unseen triangles, which have no weight
        return (mean + out**2 / (2 * ROUND))[:, 0], slope


def _couples(nodes, count: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Columns (r, p) and keys a * count + b (r, p) of the pairs a <= b of the nodes in each row (r, k)."""
    one, two = np.triu_indices(nodes.shape[1])
    turned = nodes[:, one] > nodes[:, two]
    row = np.arange(len(nodes))[:, None]
    one, two = np.where(turned, two, one), np.where(turned, one, two)
    return one, two, nodes[row, one] * count + nodes[row, two]


def _check(item: ContactSet, count: int) -> None:
    nodes, areas = np.asarray(item.nodes, int), np.asarray(item.areas, float)
    if nodes.min() < 0 or nodes.max() >= count or len(np.unique(nodes)) != len(nodes):
        raise InputError("-", "contact", "a contact node is named twice or does not exist", "mend the node list")
    if areas.shape != nodes.shape or not (np.isfinite(areas).all() and (areas > 0).all()):
        raise InputError("-", "contact", f"areas of shape {areas.shape}, or not positive", "give (s,) in mm2")
    if not len(item.faces) or np.min(item.faces) < 0 or np.max(item.faces) >= count:
        raise InputError("-", "contact", "a contact set has no faces, or one that does not exist", "mend the faces")
    if np.isin(item.faces, nodes).any():
        raise InputError("-", "contact", "a contact node is a corner of its own surface", "take it out of one")
