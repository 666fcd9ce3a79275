"""The tangent of a mesh in a fixed symmetric sparsity pattern, upper triangle, free unknowns only."""

from typing import NamedTuple

import numpy as np
from scipy import sparse

from pinnochio.compiled import compiled
from pinnochio.mechanics.elements.tetrahedra import ElementArrays, Elements, deformation, extended_log, patch_bulk

NONE = np.zeros(0)


class PatchBlocks(NamedTuple):
    """The dense matrix of each patch.

    order (m,): elements by patch, those of patch p from start[p] on; local (m, 4): an element's nodes by their place in
    its patch; nodes: those of patch p from first[p] on, ascending; place: of its node pairs in the tangent's pattern,
    from place_first[p] on; largest: most nodes of a patch.
    """

    order: np.ndarray
    start: np.ndarray
    local: np.ndarray
    first: np.ndarray
    nodes: np.ndarray
    place_first: np.ndarray
    place: np.ndarray
    largest: int


class Pattern(NamedTuple):
    """Where a node's unknowns and a node pair's entries lie.

    rank (n, 3): an unknown's place among the free ones of its node, -1 if constrained; first (n + 1,): first free
    unknown of each node; indptr: of the rows; offset (pairs,): of a node pair in the rows of its first node;
    frame (n,): number of a node's own axes, -1 for the common ones.
    """

    rank: np.ndarray
    first: np.ndarray
    indptr: np.ndarray
    offset: np.ndarray
    frame: np.ndarray


class Assembler:
    """Pattern and values of the tangent for one mesh and one set of constrained unknowns.

    Unknowns of a node: displacement along the three axes of its frame. constrained (n, 3) bool: those that the boundary
    condition fixes. framed (s,): nodes whose first axis is not x but the normal of the surface that they slide on.
    couplings (c, 2): further pairs of nodes a <= b that :meth:`add` may get, such as those of a contact.

    All nodes of a patch are coupled by its bulk term. A patch is assembled as one dense matrix and then scattered.
    """

    def __init__(self, elements: Elements, constrained, framed, couplings=None):
        self.elements, framed = elements, np.asarray(framed, int)
        nodes = elements.nodes
        used = np.zeros(nodes, bool)
        used[elements.cells] = True
        self.free = ~np.asarray(constrained, bool) & used[:, None]
        rank = np.where(self.free, np.cumsum(self.free, axis=1) - 1, -1).astype(np.int32)
        count = self.free.sum(axis=1).astype(np.int64)
        first = np.concatenate([[0], np.cumsum(count)])
        frame = np.full(nodes, -1, np.int32)
        frame[framed] = np.arange(len(framed))
        patches = _patches(elements)
        # Node pairs a <= b that share a patch, sorted; each patch stores the places of its pairs.
        keys = _pair_keys(patches.first, patches.nodes, patches.place_first, nodes)
        extra = np.zeros(0, np.int64)
        if couplings is not None and len(couplings):
            extra = couplings[:, 0].astype(np.int64) * nodes + couplings[:, 1]
        self._keys, place = np.unique(np.concatenate([keys, extra]), return_inverse=True)
        self._patches = patches._replace(place=place[: len(keys)].astype(np.int32))
        start, end = self._keys // nodes, self._keys % nodes
        width = np.concatenate([[0], np.cumsum(count[end])])
        head = np.concatenate([[0], np.cumsum(np.bincount(start, minlength=nodes))])
        offset = width[:-1] - width[head[start]]
        row = np.repeat(width[head[1:]] - width[head[:-1]], count)
        lengths = row - (np.arange(len(row)) - np.repeat(first[:-1], count))
        self.indptr = np.concatenate([[0], np.cumsum(lengths)]).astype(np.int64)
        self.indices = np.empty(self.indptr[-1], np.int32)
        _columns(self.indptr, self.indices, first, head, end)
        if self.indptr[-1] < 2**31:
            self.indptr = self.indptr.astype(np.int32)
        self._pattern = Pattern(rank, first, self.indptr, offset, frame)

    def gather(self, values: np.ndarray) -> np.ndarray:
        """Free unknowns of nodal values (n, 3) in local axes."""
        return values[self.free]

    def scatter(self, unknowns: np.ndarray) -> np.ndarray:
        """Nodal values (n, 3) in local axes of the free unknowns, zero on constrained ones."""
        padded = np.zeros(self.free.shape)
        padded[self.free] = unknowns
        return padded

    def add(self, data: np.ndarray, pairs: np.ndarray, blocks: np.ndarray) -> None:
        """Add blocks (k, 3, 3) in local axes to `data` at the node pairs a <= b (k, 2).

        What couples constrained unknowns, or nodes that the pattern does not couple, is left out.
        """
        wanted = pairs[:, 0].astype(np.int64) * len(self.free) + pairs[:, 1]
        at = np.minimum(np.searchsorted(self._keys, wanted), len(self._keys) - 1)
        known = self._keys[at] == wanted
        a, b = pairs[known].T
        at, blocks, pattern = at[known], blocks[known], self._pattern
        for i in range(3):
            for j in range(3):
                row, column = pattern.rank[a, i], pattern.rank[b, j]
                kept = (row >= 0) & (column >= 0) & ((a != b) | (j >= i))
                place = pattern.indptr[pattern.first[a[kept]] + row[kept]] + pattern.offset[at[kept]]
                np.add.at(data, place - row[kept] + column[kept], blocks[kept, i, j])

    def tangent(
        self, displacement, frames, step=None, definite=0.0, pressure=None, elements: Elements | None = None
    ) -> tuple[np.ndarray, np.ndarray]:
        """Values of the pattern at a displacement (n, 3) and the product of the tangent with `step`.

        frames (s, 3, 3): local axes of the framed nodes, in rows. step (n, 3): imposed motion in local axes, zero on
        free unknowns; its product is returned for these. definite: if not 0, elements with J at or below it or at or
        above its inverse have the negative eigenvalues of their Hessian cut off; 1 for all of them, with which the
        result is positive definite. pressure (p,) kPa: of each patch, for the geometric part, in place of that of
        the displacement. elements: the same mesh with another law, if not that of the pattern.
        """
        data = np.zeros(len(self.indices))
        product = np.zeros(self.free.shape)
        _tangent(
            u=np.ascontiguousarray(displacement, float),
            mesh=(elements or self.elements).arrays,
            patches=self._patches,
            pattern=self._pattern,
            frames=np.ascontiguousarray(frames, float),
            definite=float(definite),
            imposed=np.zeros((0, 3)) if step is None else np.ascontiguousarray(step, float),
            pressure=NONE if pressure is None else np.ascontiguousarray(pressure, float),
            data=data,
            product=product,
        )
        return data, product[self.free]

    def upper(self, data: np.ndarray) -> sparse.csr_matrix:
        """The upper triangle of a matrix over the free unknowns, from its values of the pattern."""
        return sparse.csr_matrix((data, self.indices, self.indptr), shape=(len(self.indptr) - 1,) * 2)


def _patches(elements: Elements) -> PatchBlocks:
    """The patches of a mesh, their place in a pattern left open."""
    cells, patch, nodes = elements.cells, elements.patch, elements.nodes
    member, where = np.unique(patch[:, None].astype(np.int64) * nodes + cells, return_inverse=True)
    size = np.bincount(member // nodes)
    first = np.concatenate([[0], np.cumsum(size)])
    return PatchBlocks(
        order=np.argsort(patch, kind="stable").astype(np.int32),
        start=np.concatenate([[0], np.cumsum(np.bincount(patch))]),
        local=(where.reshape(-1, 4) - first[patch][:, None]).astype(np.int32),
        first=first,
        nodes=(member % nodes).astype(np.int32),
        place_first=np.concatenate([[0], np.cumsum(size * (size + 1) // 2)]),
        place=np.zeros(0, np.int32),
        largest=int(size.max()),
    )


def diagonal_blocks(elements: Elements, displacement) -> np.ndarray:
    """Diagonal blocks (n, 3, 3) of the tangent in mN/mm at a displacement (n, 3) mm, without any constraint."""
    assembler = Assembler(elements, np.zeros((elements.nodes, 3), bool), np.zeros(0, int))
    tangent = assembler.upper(assembler.tangent(displacement, np.zeros((0, 3, 3)))[0])
    blocks = np.empty((elements.nodes, 3, 3))
    for i, j in zip(*np.triu_indices(3), strict=True):
        blocks[:, i, j] = blocks[:, j, i] = tangent.diagonal(j - i)[i::3]
    return blocks


@compiled
def _pair_keys(first, members, place_first, nodes):
    keys = np.empty(place_first[-1], np.int64)
    at = 0
    for p in range(len(first) - 1):
        for i in range(first[p], first[p + 1]):
            for j in range(i, first[p + 1]):
                keys[at] = np.int64(members[i]) * nodes + members[j]
                at += 1
    return keys


@compiled
def _columns(indptr, indices, first, head, end):
    for a in range(len(first) - 1):
        for rank in range(first[a + 1] - first[a]):
            at = indptr[first[a] + rank]
            for pair in range(head[a], head[a + 1]):
                b = end[pair]
                for column in range(first[b] + (rank if b == a else 0), first[b + 1]):
                    indices[at] = column
                    at += 1


@compiled
def _eigen(a, vectors):
    """Eigenvalues of the symmetric matrix a (3, 3) on its diagonal, by Jacobi's rotations; their vectors in columns."""
    vectors[:] = 0.0
    for i in range(3):
        vectors[i, i] = 1.0
    for _ in range(12):
        if a[0, 1] ** 2 + a[0, 2] ** 2 + a[1, 2] ** 2 <= 1e-28 * (a[0, 0] ** 2 + a[1, 1] ** 2 + a[2, 2] ** 2):
            return
        for p in range(2):
            for q in range(p + 1, 3):
                if a[p, q] == 0:
                    continue
                ratio = (a[q, q] - a[p, p]) / (2 * a[p, q])
                t = (1.0 if ratio >= 0 else -1.0) / (abs(ratio) + np.sqrt(1 + ratio * ratio))
                c = 1 / np.sqrt(1 + t * t)
                s = t * c
                for k in range(3):
                    x, y = a[k, p], a[k, q]
                    a[k, p], a[k, q] = c * x - s * y, s * x + c * y
                for k in range(3):
                    x, y = a[p, k], a[q, k]
                    a[p, k], a[q, k] = c * x - s * y, s * x + c * y
                for k in range(3):
                    x, y = vectors[k, p], vectors[k, q]
                    vectors[k, p], vectors[k, q] = c * x - s * y, s * x + c * y


@compiled
def _lift(f, g, v, shear, stretch, bulk, curve, k):
    """Takes the negative part of the Hessian off the blocks k (4, 4, 3, 3) of one element.

    With F = U S V', s the singular values: the eigenmatrices are U A V' with A antisymmetric (shear + bulk s_i),
    symmetric off the diagonal (shear - bulk s_i), or diagonal, of a matrix of 3 by 3.
    """
    size = 0.0
    for i in range(3):
        for j in range(3):
            size += f[i, j] * f[i, j]
    if curve >= 0 and 2 * abs(bulk) * np.sqrt(size) < shear:
        return
    a, right, left, modes = np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3))
    for i in range(3):
        for j in range(3):
            a[i, j] = f[0, i] * f[0, j] + f[1, i] * f[1, j] + f[2, i] * f[2, j]
    _eigen(a, right)
    # The least singular value last: its left vector is the cross product, its sign that of J.
    last = 0
    for i in range(1, 3):
        if a[i, i] < a[last, last]:
            last = i
    one, two = (last + 1) % 3, (last + 2) % 3
    s = np.zeros(3)
    for m in (one, two):
        s[m] = np.sqrt(max(a[m, m], 1e-300))
        for i in range(3):
            left[i, m] = (f[i, 0] * right[0, m] + f[i, 1] * right[1, m] + f[i, 2] * right[2, m]) / s[m]
    for i in range(3):
        p, q = (i + 1) % 3, (i + 2) % 3
        left[i, last] = left[p, one] * left[q, two] - left[q, one] * left[p, two]
    for i in range(3):
        s[last] += left[i, last] * (f[i, 0] * right[0, last] + f[i, 1] * right[1, last] + f[i, 2] * right[2, last])
    c = np.array([s[1] * s[2], s[2] * s[0], s[0] * s[1]])
    for i in range(3):
        for j in range(3):
            a[i, j] = stretch * s[i] * s[j] + curve * c[i] * c[j]
            a[i, j] += shear if i == j else bulk * s[3 - i - j]
    _eigen(a, modes)
    mode, image, turned = np.empty((3, 3)), np.empty((4, 3)), np.empty((4, 3))
    for b in range(4):
        for m in range(3):
            turned[b, m] = right[0, m] * g[b, 0] + right[1, m] * g[b, 1] + right[2, m] * g[b, 2]
    for number in range(9):
        m = number % 3
        p, q = (m + 1) % 3, (m + 2) % 3
        mode[:] = 0.0
        if number < 3:
            value = a[m, m]
            for i in range(3):
                mode[i, i] = modes[i, m]
        else:
            value = shear + (bulk if number < 6 else -bulk) * s[m]
            mode[p, q] = np.sqrt(0.5)
            mode[q, p] = -mode[p, q] if number < 6 else mode[p, q]
        if value >= 0:
            continue
        for b in range(4):
            for i in range(3):
                image[b, i] = 0.0
            for r in range(3):
                along = mode[r, 0] * turned[b, 0] + mode[r, 1] * turned[b, 1] + mode[r, 2] * turned[b, 2]
                for i in range(3):
                    image[b, i] += left[i, r] * along
        for b in range(4):
            for d in range(b, 4):
                for i in range(3):
                    for j in range(3):
                        k[b, d, i, j] -= v * value * image[b, i] * image[d, j]


@compiled
def _element(f, cof, g, v, shear, stretch, bulk, curve, fg, cg, k):
    """Blocks k (4, 4, 3, 3) of one element, of nodes a <= b; fg and cg (4, 3) are F and cof F times the gradients."""
    for a in range(4):
        for i in range(3):
            fg[a, i] = f[i, 0] * g[a, 0] + f[i, 1] * g[a, 1] + f[i, 2] * g[a, 2]
            cg[a, i] = cof[i, 0] * g[a, 0] + cof[i, 1] * g[a, 1] + cof[i, 2] * g[a, 2]
    for a in range(4):
        for b in range(a, 4):
            alike = shear * (g[a, 0] * g[b, 0] + g[a, 1] * g[b, 1] + g[a, 2] * g[b, 2])
            n0 = g[a, 1] * g[b, 2] - g[a, 2] * g[b, 1]
            n1 = g[a, 2] * g[b, 0] - g[a, 0] * g[b, 2]
            n2 = g[a, 0] * g[b, 1] - g[a, 1] * g[b, 0]
            for i in range(3):
                for q in range(3):
                    k[a, b, i, q] = v * (stretch * fg[a, i] * fg[b, q] + curve * cg[a, i] * cg[b, q])
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


@compiled
def _turn(dense, at, count, axes):
    """Rows and columns of the node at place `at` of a patch's matrix, upper blocks, into its own axes."""
    first_row = 3 * at
    for column in range(first_row, 3 * count):
        x, y, z = dense[first_row, column], dense[first_row + 1, column], dense[first_row + 2, column]
        for i in range(3):
            dense[first_row + i, column] = axes[i, 0] * x + axes[i, 1] * y + axes[i, 2] * z
    for row in range(first_row + 3):
        x, y, z = dense[row, first_row], dense[row, first_row + 1], dense[row, first_row + 2]
        for i in range(3):
            dense[row, first_row + i] = axes[i, 0] * x + axes[i, 1] * y + axes[i, 2] * z


@compiled
def _tangent(
    u, mesh: ElementArrays, patches: PatchBlocks, pattern: Pattern, frames, definite, imposed, pressure, data, product
):
    """Adds to data and product; imposed (n, 3) and pressure (p,) are empty where there are none."""
    f, cof = np.empty((3, 3)), np.empty((3, 3))
    k, fg, cg = np.empty((4, 4, 3, 3)), np.empty((4, 3)), np.empty((4, 3))
    dense, spread = np.empty((3 * patches.largest, 3 * patches.largest)), np.empty(3 * patches.largest)
    first, second = np.empty(len(mesh.patch_volumes)), np.empty(len(mesh.patch_volumes))
    patch_bulk(u, mesh, first, second)
    if len(pressure):
        first[:] = pressure
    for p in range(len(mesh.patch_volumes)):
        nodes = patches.nodes[patches.first[p] : patches.first[p + 1]]
        count = len(nodes)
        dense[: 3 * count, : 3 * count] = 0.0
        spread[: 3 * count] = 0.0
        for e in patches.order[patches.start[p] : patches.start[p + 1]]:
            gradients, v, mu, stiffening = mesh.gradients[e], mesh.volumes[e], mesh.mu[e], mesh.stiffening[e]
            j, excess = deformation(u, mesh.cells[e], gradients, f, cof)
            _, d, dd = extended_log(j, mesh.extension)
            shear, bulk, curve = mu + 2 * stiffening * excess, first[p] - mu * d, -mu * dd
            _element(f, cof, gradients, v, shear, 4 * stiffening, bulk, curve, fg, cg, k)
            if definite > 0 and not definite < j < 1 / definite:
                _lift(f, gradients, v, shear, 4 * stiffening, bulk, curve, k)
            for a in range(4):
                row = 3 * patches.local[e, a]
                for i in range(3):
                    spread[row + i] += v * cg[a, i]
                for b in range(a, 4):
                    column = 3 * patches.local[e, b]
                    for i in range(3):
                        for q in range(3):
                            if row <= column:
                                dense[row + i, column + q] += k[a, b, i, q]
                            else:
                                dense[column + q, row + i] += k[a, b, i, q]
        stiffness = second[p] / mesh.patch_volumes[p]
        if definite == 1:
            stiffness = max(stiffness, 0.0)
        for i in range(3 * count):
            for q in range(i - i % 3, 3 * count):
                dense[i, q] += stiffness * spread[i] * spread[q]
        for a in range(count):
            if pattern.frame[nodes[a]] >= 0:
                _turn(dense, a, count, frames[pattern.frame[nodes[a]]])
        pair = patches.place_first[p]
        for a in range(count):
            na = nodes[a]
            for b in range(a, count):
                nb = nodes[b]
                if len(imposed):
                    for i in range(3):
                        for q in range(3):
                            value = dense[3 * a + i, 3 * b + q]
                            product[na, i] += value * imposed[nb, q]
                            if a != b:
                                product[nb, q] += value * imposed[na, i]
                for i in range(3):
                    rank = pattern.rank[na, i]
                    if rank >= 0:
                        at = pattern.indptr[pattern.first[na] + rank] + pattern.offset[patches.place[pair]] - rank
                        for q in range(i if a == b else 0, 3):
                            if pattern.rank[nb, q] >= 0:
                                data[at + pattern.rank[nb, q]] += dense[3 * a + i, 3 * b + q]
                pair += 1
