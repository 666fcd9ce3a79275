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

The tangent is kappa A / 2 grad f grad f' of every node, positive by itself. The rest of the Hessian, g d2f, is left
out: with it, or with its positive part, Newton's method took up to five times as many factorisations [X].
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from pinnochio.compiled import compiled
from pinnochio.errors import InputError
from pinnochio.geometry.triangles import face_normals

# Triangles within it at rest can be touched, mm; what lips slide along each other stays below [I].
REACH = 12.0
FEWEST = 6  # triangles that a node sees at least, however coarse the mesh
WIDTH = 0.25  # h over the square root of the mean area of the triangles
NEGLIGIBLE = 1e-7  # derivative of f by a node that the tangent leaves out; its square: weight that counts for none
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
        self._last: tuple = (np.zeros(0), [])
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

    def tangent(self, displacement) -> tuple[np.ndarray, np.ndarray]:
        """Pairs (k, 2), among `pairs`, and blocks (k, 3, 3) in mN/mm: axis i of node a with axis j of node b."""
        blocks, used = np.zeros((len(self.pairs), 3, 3)), np.zeros(len(self.pairs), bool)
        for side, scale, gap, slope in self._gaps(displacement):
            row = np.flatnonzero(gap < 0)
            if len(row):
                size = np.abs(slope[row]).max(axis=2)
                count = int((size > NEGLIGIBLE).sum(axis=1).max())
                column = np.argsort(-size, axis=1, kind="stable")[:, :count]
                one, two, key = _couples(np.take_along_axis(side.stencil[row], column, axis=1), len(self.points))
                place, near = np.searchsorted(self._keys, key), np.arange(len(row))[:, None]
                used[place], pull = True, slope[row[:, None], column]
                pair = pull[near, one][..., :, None] * pull[near, two][..., None, :]
                np.add.at(blocks, place, scale[row, None, None, None] * pair)
        return self.pairs[used], blocks[used]

    def gaps(self, displacement) -> np.ndarray:
        """Gap (s,) in mm at the contact nodes, in the order of `nodes`, negative where one has entered."""
        return np.concatenate([np.zeros(0)] + [side.gap for side in self._gaps(displacement)])

    def _gaps(self, displacement) -> list["_Gap"]:
        """The gaps of every side; the last ones are kept."""
        if not np.array_equal(self._last[0], displacement):
            sides = zip(self._sides, self._scale, self._distances(displacement), self._levels, strict=True)
            self._last = (
                np.array(displacement),
                [_Gap(side, scale, f - level, by) for side, scale, (f, by), level in sides],
            )
        return self._last[1]

    def _distances(self, displacement) -> list[tuple[np.ndarray, np.ndarray]]:
        moved = self.points + displacement
        return [side.local(moved[side.stencil]) for side in self._sides]


class _Gap(NamedTuple):
    """Stiffness (s,) mN/mm, gap (s,) mm and its derivative (s, k, 3) by the nodes of a side's stencil."""

    side: "_Faces"
    scale: np.ndarray
    gap: np.ndarray
    slope: np.ndarray


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

    def local(self, here) -> tuple[np.ndarray, np.ndarray]:
        """Signed distance (s,) and its derivative (s, k, 3), moved points of the stencil (s, k, 3)."""
        value, slope = np.empty(len(here)), np.zeros(here.shape)
        _local(here, self._column, self._seen, self._width, value, slope)
        return value, slope


@compiled
def _dot(a, b):
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@compiled
def _cross(a, b):
    return np.array([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])


@compiled
def _less(a, b, share=1.0):
    """a - share b, (3,), as a tuple: an array is asked of the system each time."""
    return a[0] - share * b[0], a[1] - share * b[1], a[2] - share * b[2]


@compiled
def _closest(x, corners, shares):
    """Squared distance of x (3,) from a triangle (3, 3), the closest point of which has these shares (3,)."""
    e, f, g = _less(corners[1], corners[0]), _less(corners[2], corners[0]), _less(x, corners[0])
    ee, ef, ff, ge, gf = _dot(e, e), _dot(e, f), _dot(f, f), _dot(g, e), _dot(g, f)
    area = max(ee * ff - ef * ef, 1e-300)
    shares[1], shares[2] = (ff * ge - ef * gf) / area, (ee * gf - ef * ge) / area
    shares[0] = 1 - shares[1] - shares[2]
    if min(shares[0], shares[1], shares[2]) >= 0:
        away = _less(_less(g, e, shares[1]), f, shares[2])
        return _dot(away, away)
    least = np.inf
    for i in range(3):
        j = (i + 1) % 3
        along, start = _less(corners[j], corners[i]), _less(x, corners[i])
        share = min(max(_dot(start, along) / max(_dot(along, along), 1e-300), 0.0), 1.0)
        away = _less(start, along, share)
        if _dot(away, away) < least:
            least = _dot(away, away)
            shares[i], shares[j], shares[3 - i - j] = 1 - share, share, 0.0
    return least


@compiled
def _plane(x, corners):
    """Unit normal (3,) of a triangle (3, 3), twice its area, the offset (3,) of x from its middle and its height."""
    normal = _cross(corners[1] - corners[0], corners[2] - corners[0])
    length = max(np.sqrt(_dot(normal, normal)), 1e-12)
    normal, offset = normal / length, x - (corners[0] + corners[1] + corners[2]) / 3
    return normal, length, offset, _dot(normal, offset)


@compiled
def _local(here, column, seen, width, value, slope):
    square, shares = np.empty(column.shape[1]), np.empty((column.shape[1], 3))
    for s in range(len(here)):
        x, moved, count = here[s, 0], here[s], seen[s].sum()
        for c in range(count):
            a, b, d = column[s, c]
            square[c] = _closest(x, (moved[a], moved[b], moved[d]), shares[c])
        weight = np.exp((square[:count].min() - square[:count]) / width**2)
        weight /= weight.sum()
        mean, beside, near = 0.0, 0.0, np.flatnonzero(weight > NEGLIGIBLE**2)
        for c in near:
            plane = _plane(x, moved[column[s, c]])[3]
            mean += weight[c] * plane
            beside += weight[c] * (square[c] - plane**2)
        out = max(np.sqrt(max(beside, 0.0)) - width, 0.0)
        value[s] = mean + out**2 / (2 * ROUND)
        rise = out / (2 * ROUND * (width + out))  # derivative by t^2
        for c in near:
            corners, share = moved[column[s, c]], shares[c]
            normal, length, offset, plane = _plane(x, corners)
            # Derivatives by p_c and d_c^2, the latter in itself and in the weights.
            by_plane, aside = weight[c] * (1 - 2 * rise * plane), square[c] - plane**2
            by_square = weight[c] * (rise - (plane - mean + rise * (aside - beside)) / width**2)
            # That the closest point moves along its triangle changes the distance not at all, to first order.
            pull = 2 * by_square * (x - share[0] * corners[0] - share[1] * corners[1] - share[2] * corners[2])
            along = by_plane * normal
            # The normal is first x second over its length.
            turn = by_plane * (offset - plane * normal) / length
            by_first, by_second = _cross(corners[2] - corners[0], turn), _cross(turn, corners[1] - corners[0])
            slope[s, 0] += along + pull
            slope[s, column[s, c, 0]] -= by_first + by_second + along / 3 + share[0] * pull
            slope[s, column[s, c, 1]] += by_first - along / 3 - share[1] * pull
            slope[s, column[s, c, 2]] += by_second - along / 3 - share[2] * pull


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
