"""The tangent of a mesh in a fixed symmetric sparsity pattern, upper triangle, free unknowns only."""

import numpy as np
from numba import njit

from pinnochio.mechanics.elements import Elements, _log, _nodal, _strain

_EPSILON = np.zeros((3, 3, 3))
_EPSILON[0, 1, 2] = _EPSILON[1, 2, 0] = _EPSILON[2, 0, 1] = 1
_EPSILON[0, 2, 1] = _EPSILON[2, 1, 0] = _EPSILON[1, 0, 2] = -1


class Assembler:
    """Pattern and values of the tangent for one mesh and one set of constrained unknowns.

    Unknowns of a node: displacement along the three axes of its frame and, with averaged volume, the multiplier of
    its bulk term. constrained (n, 3) bool: the displacement unknowns that the boundary condition fixes.
    framed (s,): nodes whose first axis is not x but the normal of the surface that they slide on.
    """

    def __init__(self, elements: Elements, constrained: np.ndarray, framed: np.ndarray):
        self.elements, self.framed = elements, framed
        nodes = len(elements.node_volumes)
        free = np.zeros((nodes, 4), bool)
        free[:, :3] = ~constrained & (elements.node_volumes > 0)[:, None]
        free[:, 3] = elements.averaged & (elements.node_volumes > 0)
        self.free = free
        self.displacements, self.multipliers = int(free[:, :3].sum()), int(free[:, 3].sum())
        self._rank = np.where(free, np.cumsum(free, axis=1) - 1, -1).astype(np.int32)
        count = free.sum(axis=1).astype(np.int64)
        self._first = np.concatenate([[0], np.cumsum(count)])
        self._frame = np.full(nodes, -1, np.int32)
        self._frame[framed] = np.arange(len(framed))
        # Node pairs a <= b of the element graph, sorted; each element stores the place of its 16 pairs.
        low = np.minimum(elements.cells[:, :, None], elements.cells[:, None, :]).astype(np.int64)
        high = np.maximum(elements.cells[:, :, None], elements.cells[:, None, :])
        pairs, place = np.unique((low * nodes + high).ravel(), return_inverse=True)
        start, end = pairs // nodes, pairs % nodes
        width = np.concatenate([[0], np.cumsum(count[end])])
        head = np.concatenate([[0], np.cumsum(np.bincount(start, minlength=nodes))])
        self._offset = width[:-1] - width[head[start]]
        self._place = place.reshape(-1, 4, 4).astype(np.int32)
        lengths = np.concatenate(
            [total - np.arange(c) for total, c in zip(width[head[1:]] - width[head[:-1]], count, strict=True)]
        )
        self.indptr = np.concatenate([[0], np.cumsum(lengths)]).astype(np.int64)
        self.indices = np.empty(self.indptr[-1], np.int32)
        _columns(self.indptr, self.indices, self._first, head, end)
        if self.indptr[-1] < 2**31:
            self.indptr = self.indptr.astype(np.int32)

    def gather(self, values: np.ndarray) -> np.ndarray:
        """Free unknowns of nodal values (n, 3) in local axes; multipliers zero."""
        padded = np.zeros(self.free.shape)
        padded[:, :3] = values
        return padded[self.free]

    def scatter(self, unknowns: np.ndarray) -> np.ndarray:
        """Nodal values (n, 3) in local axes of the free unknowns, zero on constrained ones."""
        padded = np.zeros(self.free.shape)
        padded[self.free] = unknowns
        return padded[:, :3]

    def add_tangential(self, data: np.ndarray, blocks: np.ndarray) -> None:
        """Add blocks (s, 2, 2) to `data` at the second and third unknowns of the framed nodes, if these are free."""
        for i, j in ((1, 1), (1, 2), (2, 2)):
            row, column = self._rank[self.framed, i], self._rank[self.framed, j]
            both = (row >= 0) & (column >= 0)
            place = self.indptr[self._first[self.framed[both]] + row[both]] + column[both] - row[both]
            data[place] += blocks[both, i - 1, j - 1]

    def tangent(self, displacement, frames, step=None, definite=False) -> tuple[np.ndarray, np.ndarray]:
        """Values of the pattern at a displacement (n, 3) and the product of the tangent with `step`.

        frames (s, 3, 3): local axes of the framed nodes, in rows. step (n, 3): imposed motion of the constrained
        unknowns in local axes; its product is returned for the free unknowns. definite: every element's Hessian
        with its negative eigenvalues cut off, so that the result is positive definite.
        """
        mesh, law = self.elements, self.elements.material
        data = np.zeros(len(self.indices))
        product = np.zeros(self.free.shape)
        imposed = np.zeros((len(self.free), 3)) if step is None else np.ascontiguousarray(step, float)
        _tangent(
            *(np.ascontiguousarray(displacement, float), mesh.cells, mesh.gradients, mesh.volumes),
            *(mesh.node_volumes, law.mu, law.lam, law.stiffening, mesh.node_lam, law.extension, mesh.averaged),
            *(mesh.modulus * mesh.edge, definite, self._frame, np.ascontiguousarray(frames, float)),
            *(self._rank, self._first, self.indptr, self._place, self._offset, imposed, step is not None),
            *(data, product),
        )
        return data, product[self.free]


@njit(cache=True)
def _columns(indptr, indices, first, head, end):
    for a in range(len(first) - 1):
        for rank in range(first[a + 1] - first[a]):
            at = indptr[first[a] + rank]
            for pair in range(head[a], head[a + 1]):
                b = end[pair]
                for column in range(first[b] + (rank if b == a else 0), first[b + 1]):
                    indices[at] = column
                    at += 1


@njit(cache=True)
def _hessian(f, cof, shear, stretch, bulk, curve, h):
    """d2Psi/dF2 (9, 9) = shear I + stretch F F' + bulk d2J + curve cof cof'."""
    for i in range(3):
        for p in range(3):
            for j in range(3):
                for q in range(3):
                    value = stretch * f[i, p] * f[j, q] + curve * cof[i, p] * cof[j, q]
                    if i == j and p == q:
                        value += shear
                    for k in range(3):
                        for r in range(3):
                            value += bulk * _EPSILON[i, j, k] * _EPSILON[p, q, r] * f[k, r]
                    h[3 * i + p, 3 * j + q] = value


@njit(cache=True)
def _cut(h):
    """h with its negative eigenvalues set to zero."""
    values, vectors = np.linalg.eigh(h)
    scaled = vectors * np.sqrt(np.maximum(values, 0.0))
    return scaled @ scaled.T


@njit(cache=True)
def _tangent(
    u,
    cells,
    gradients,
    volumes,
    node_volumes,
    mu,
    lam,
    stiffening,
    node_lam,
    extension,
    averaged,
    unit,
    definite,
    frame,
    frames,
    rank,
    first_row,
    indptr,
    place,
    offset,
    imposed,
    coupled,
    data,
    product,
):
    nodes = len(node_volumes)
    f, cof = np.empty((3, 3)), np.empty((3, 3))
    h = np.empty((9, 9))
    k = np.empty((4, 4, 3, 3))
    fg, cg = np.empty((4, 3)), np.empty((4, 3))
    turned = np.empty((3, 3))
    first, second = np.zeros(nodes), np.zeros(nodes)
    scale = np.zeros(nodes)
    if averaged:
        _nodal(u, cells, gradients, volumes, node_volumes, node_lam, extension, first, second)
        for a in range(nodes):
            if node_volumes[a] > 0:
                # Beyond J_a = e the bulk term is concave; it is left out of the matrix there.
                scale[a] = np.sqrt(unit * max(second[a], 0.0) / node_volumes[a])
                if rank[a, 3] >= 0:
                    data[indptr[first_row[a] + rank[a, 3]]] = -unit
    for e in range(len(cells)):
        cell, g, v = cells[e], gradients[e], volumes[e]
        j, excess = _strain(u, cell, g, f, cof)
        log, d, dd = _log(j, extension)
        shear = mu[e] + 2 * stiffening[e] * excess
        bulk, curve = -mu[e] * d, -mu[e] * dd
        if averaged:
            for a in range(4):
                bulk += 0.25 * first[cell[a]]
        else:
            bulk += lam[e] * log * d
            curve += lam[e] * (d * d + log * dd)
        for a in range(4):
            for i in range(3):
                fg[a, i] = f[i, 0] * g[a, 0] + f[i, 1] * g[a, 1] + f[i, 2] * g[a, 2]
                cg[a, i] = cof[i, 0] * g[a, 0] + cof[i, 1] * g[a, 1] + cof[i, 2] * g[a, 2]
        if definite:
            _hessian(f, cof, shear, 4 * stiffening[e], bulk, curve, h)
            cut = _cut(h)
            for a in range(4):
                for b in range(4):
                    for i in range(3):
                        for q in range(3):
                            value = 0.0
                            for p in range(3):
                                for r in range(3):
                                    value += g[a, p] * cut[3 * i + p, 3 * q + r] * g[b, r]
                            k[a, b, i, q] = v * value
        else:
            for a in range(4):
                for b in range(4):
                    alike = shear * (g[a, 0] * g[b, 0] + g[a, 1] * g[b, 1] + g[a, 2] * g[b, 2])
                    n0 = g[a, 1] * g[b, 2] - g[a, 2] * g[b, 1]
                    n1 = g[a, 2] * g[b, 0] - g[a, 0] * g[b, 2]
                    n2 = g[a, 0] * g[b, 1] - g[a, 1] * g[b, 0]
                    for i in range(3):
                        for q in range(3):
                            k[a, b, i, q] = v * (4 * stiffening[e] * fg[a, i] * fg[b, q] + curve * cg[a, i] * cg[b, q])
                        k[a, b, i, i] += v * alike
                    # d2J/du_a du_b is the skew matrix of F (grad_a x grad_b).
                    w0 = v * bulk * (f[0, 0] * n0 + f[0, 1] * n1 + f[0, 2] * n2)
                    w1 = v * bulk * (f[1, 0] * n0 + f[1, 1] * n1 + f[1, 2] * n2)
                    w2 = v * bulk * (f[2, 0] * n0 + f[2, 1] * n1 + f[2, 2] * n2)
                    k[a, b, 0, 1] += w2
                    k[a, b, 1, 0] -= w2
                    k[a, b, 0, 2] -= w1
                    k[a, b, 2, 0] += w1
                    k[a, b, 1, 2] += w0
                    k[a, b, 2, 1] -= w0
        for a in range(4):
            at = frame[cell[a]]
            if at >= 0:
                axes = frames[at]
                for b in range(4):
                    for i in range(3):
                        for q in range(3):
                            turned[i, q] = (
                                axes[i, 0] * k[a, b, 0, q] + axes[i, 1] * k[a, b, 1, q] + axes[i, 2] * k[a, b, 2, q]
                            )
                    k[a, b] = turned
                    for i in range(3):
                        for q in range(3):
                            turned[i, q] = (
                                axes[q, 0] * k[b, a, i, 0] + axes[q, 1] * k[b, a, i, 1] + axes[q, 2] * k[b, a, i, 2]
                            )
                    k[b, a] = turned
                c0, c1, c2 = cg[a, 0], cg[a, 1], cg[a, 2]
                for i in range(3):
                    cg[a, i] = axes[i, 0] * c0 + axes[i, 1] * c1 + axes[i, 2] * c2
        for a in range(4):
            na = cell[a]
            for b in range(4):
                nb = cell[b]
                if coupled:
                    for q in range(3):
                        if rank[nb, q] < 0 and imposed[nb, q] != 0.0:
                            for i in range(3):
                                product[na, i] += k[a, b, i, q] * imposed[nb, q]
                            product[na, 3] += 0.25 * v * scale[na] * cg[b, q] * imposed[nb, q]
                if na > nb:
                    continue
                pair = offset[place[e, a, b]]
                for i in range(3):
                    if rank[na, i] < 0:
                        continue
                    at = indptr[first_row[na] + rank[na, i]] + pair - rank[na, i]
                    for q in range(i if a == b else 0, 3):
                        if rank[nb, q] >= 0:
                            data[at + rank[nb, q]] += k[a, b, i, q]
                    if averaged and rank[nb, 3] >= 0:
                        data[at + rank[nb, 3]] += 0.25 * v * scale[nb] * cg[a, i]
                if averaged and a != b and rank[na, 3] >= 0:
                    at = indptr[first_row[na] + rank[na, 3]] + pair - rank[na, 3]
                    for q in range(3):
                        if rank[nb, q] >= 0:
                            data[at + rank[nb, q]] += 0.25 * v * scale[na] * cg[b, q]
