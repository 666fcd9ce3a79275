"""The energy of :mod:`pinnochio.mechanics.elements.tetrahedra` for many plans, in torch, its force and its tangent.

Arrays: displacements (n, 3, k) mm of k plans, numbers of the elements (m, k), of the patches (p, k). Tensors of 3 by 3
are lists of their components, from which a compiler makes few kernels. `extension` (k,): that of ln J, of each plan.
"""

from typing import NamedTuple

import numpy as np
import torch
from scipy import sparse
from torch import Tensor

from pinnochio.mechanics.elements.tetrahedra import Elements
from pinnochio.mechanics.solvers.batched.sparse_rows import SparseRows, fused


class Constants(NamedTuple):
    """Of the elements cells (m, 4), gradients (m, 4, 3), patch (m,), volumes, mu, stiffening (m, 1), of the patches
    patch_volumes, patch_lam (p, 1)."""

    cells: Tensor
    gradients: Tensor
    patch: Tensor
    volumes: Tensor
    mu: Tensor
    stiffening: Tensor
    patch_volumes: Tensor
    patch_lam: Tensor


class BatchState(NamedTuple):
    """Energy (k,) mN mm, force (n, 3, k) mN, J and I1 (m, k), and what the tangent needs: derivatives of the patches'
    energy by their volume ratio (p, k) kPa."""

    energy: Tensor
    force: Tensor
    ratio: Tensor
    stretch: Tensor
    first: Tensor
    second: Tensor


class BatchElements:
    """Elements of a mesh on a device; dtype: of all its arithmetic."""

    def __init__(self, elements: Elements, device, dtype: torch.dtype = torch.float64):
        def real(values):
            return torch.as_tensor(np.asarray(values, float), dtype=dtype, device=device)

        law, count, patches = elements.material, len(elements.cells), len(elements.patch_volumes)
        self.constants = Constants(
            torch.as_tensor(elements.cells, dtype=torch.long, device=device),
            real(elements.gradients),
            torch.as_tensor(elements.patch, dtype=torch.long, device=device),
            *(real(item)[:, None] for item in (elements.volumes, law.mu, law.stiffening)),
            *(real(item)[:, None] for item in (elements.patch_volumes, elements.patch_lam)),
        )
        members = np.arange(count)
        ones = sparse.csr_array((np.ones(count), (elements.patch, members)), (patches, count))
        volumes = sparse.csr_array((elements.volumes, (elements.patch, members)), (patches, count))
        corners = (np.ones(4 * count), (elements.cells.ravel(), np.arange(4 * count)))
        self.of_patches, self._in_patches = SparseRows(ones, device, torch.float32), SparseRows(volumes, device, dtype)
        self._at_nodes = SparseRows(sparse.csr_array(corners, (elements.nodes, 4 * count)), device, dtype)

    def measure(self, u: Tensor, extension: Tensor) -> BatchState:
        ratio, stretch = _ratios(u, self.constants)
        energy, first, second = _bulk(self._in_patches(ratio), self.constants, extension)
        force, of_elements = _forces(u, self.constants, first, extension)
        force = self._at_nodes(force.view(-1, 3, u.shape[2]))
        return BatchState(energy.sum(0) + of_elements.sum(0), force, ratio, stretch, first, second)

    def curvature(self, u: Tensor, state: BatchState, extension: Tensor) -> tuple[Tensor, Tensor]:
        """What :meth:`product` needs of a state; and the blocks (n, 9, k) of the tangent at the nodes, about."""
        kept, blocks = _curvature(u, self.constants, state.first, state.second, extension)
        return kept, self._at_nodes(blocks.view(-1, 9, u.shape[2]))

    def product(self, kept: Tensor, second: Tensor, step: Tensor) -> Tensor:
        """The tangent times a step (n, 3, k)."""
        change = self._in_patches(_change(step, self.constants, kept))
        forces = _tangent_forces(step, self.constants, kept, change * second / self.constants.patch_volumes)
        return self._at_nodes(forces.view(-1, 3, step.shape[2]))


def damped(kept: Tensor, second: Tensor) -> tuple[Tensor, Tensor]:
    """What :meth:`Mesh.product` needs of a tangent that is positive definite, in place of an indefinite one.

    The bulk's bend has eigenvalues within twice its factor times the norm of F, which the shear outweighs then.
    """
    most = 0.5 * kept[9] / torch.sqrt((kept[:9] * kept[:9]).sum(0)).clamp(min=1e-6)
    bounded = torch.minimum(torch.maximum(kept[10], -most), most)
    return torch.cat([kept[:10], bounded[None], kept[11:]]), second.clamp(min=0)


def _gradient(u, c: Constants) -> list[list[Tensor]]:
    corners = [[u[c.cells[:, a], i] for i in range(3)] for a in range(4)]
    slopes = [[c.gradients[:, a, j, None] for j in range(3)] for a in range(4)]
    return [[sum(corners[a][i] * slopes[a][j] for a in range(4)) for j in range(3)] for i in range(3)]


def _deformation(h) -> list[list[Tensor]]:
    return [[h[i][j] + 1 if i == j else h[i][j] for j in range(3)] for i in range(3)]


def cofactor(f) -> list[list[Tensor]]:
    after = (1, 2, 0)
    return [
        [
            f[after[i]][after[j]] * f[after[after[i]]][after[after[j]]]
            - f[after[i]][after[after[j]]] * f[after[after[i]]][after[j]]
            for j in range(3)
        ]
        for i in range(3)
    ]


def determinant(f, cof) -> Tensor:
    """Of f (3, 3), by its cofactors."""
    return f[0][0] * cof[0][0] + f[0][1] * cof[0][1] + f[0][2] * cof[0][2]


def _dot(a, b) -> Tensor:
    return sum(a[i][j] * b[i][j] for i in range(3) for j in range(3))


def _excess(h) -> Tensor:
    """I1 - 3, free of cancellation near rest."""
    return _dot(h, h) + 2 * (h[0][0] + h[1][1] + h[2][2])


def _log(j, extension):
    """As :func:`pinnochio.mechanics.elements.tetrahedra.extended_log`."""
    inside = torch.maximum(j, extension)
    d = (j - inside) / inside
    return torch.log(inside) + d - 0.5 * d * d, (1 - d) / inside, -1 / (inside * inside)


def _at_corners(p, c: Constants) -> list[Tensor]:
    """Products of p (3, 3) with the gradients of the corners."""
    return [sum(p[i][j] * c.gradients[:, a, j, None] for j in range(3)) for a in range(4) for i in range(3)]


def _stresses(u, c, first, extension):
    """Deformation gradient, its cofactors, I1 - 3, ln J with its derivatives, and what the stress has of each of the
    first two, times the volume."""
    h = _gradient(u, c)
    f, excess = _deformation(h), _excess(h)
    cof = cofactor(f)
    log = _log(determinant(f, cof), extension)
    shear = c.volumes * (c.mu + 2 * c.stiffening * excess)
    bulk = c.volumes * (first[c.patch] - c.mu * log[1])
    return f, cof, excess, log, shear, bulk


@fused
def _ratios(u, c):
    h = _gradient(u, c)
    f = _deformation(h)
    return determinant(f, cofactor(f)), _excess(h) + 3


@fused
def _bulk(volume, c, extension):
    log, d, dd = _log(volume / c.patch_volumes, extension)
    return 0.5 * c.patch_volumes * c.patch_lam * log * log, c.patch_lam * log * d, c.patch_lam * (d * d + log * dd)


@fused
def _forces(u, c, first, extension):
    f, cof, excess, (log, _, _), shear, bulk = _stresses(u, c, first, extension)
    p = [[shear * f[i][j] + bulk * cof[i][j] for j in range(3)] for i in range(3)]
    energy = c.volumes * (0.5 * c.mu * excess + 0.5 * c.stiffening * excess * excess - c.mu * log)
    return torch.stack(_at_corners(p, c), 1), energy


@fused
def _curvature(u, c, first, second, extension):
    f, cof, _, (_, _, dd), shear, bulk = _stresses(u, c, first, extension)
    curve = -c.volumes * c.mu * dd
    kept = torch.stack([*f[0], *f[1], *f[2], shear, bulk, curve], 0)
    stiff = torch.clamp(curve + c.volumes * c.volumes * (second / c.patch_volumes)[c.patch], min=0)
    blocks = []
    for a in range(4):
        g = [c.gradients[:, a, j, None] for j in range(3)]
        fg = [sum(f[i][j] * g[j] for j in range(3)) for i in range(3)]
        cg = [sum(cof[i][j] * g[j] for j in range(3)) for i in range(3)]
        alike, stretch = shear * sum(x * x for x in g), 4 * c.stiffening * c.volumes
        blocks += [
            stretch * fg[i] * fg[j] + stiff * cg[i] * cg[j] + (alike if i == j else 0)
            for i in range(3)
            for j in range(3)
        ]
    return kept, torch.stack(blocks, 1)


def _kept(kept):
    return [[kept[3 * i + j] for j in range(3)] for i in range(3)], kept[9], kept[10], kept[11]


@fused
def _change(step, c, kept):
    f, _, _, _ = _kept(kept)
    return _dot(cofactor(f), _gradient(step, c))


@fused
def _tangent_forces(step, c, kept, pressure):
    f, shear, bulk, curve = _kept(kept)
    df, cof, after = _gradient(step, c), cofactor(f), (1, 2, 0)
    along = curve * _dot(cof, df) + c.volumes * pressure[c.patch]
    stretch = 4 * c.stiffening * c.volumes * _dot(f, df)
    p = []
    for i in range(3):
        one, two = after[i], after[after[i]]
        row = []
        for j in range(3):
            r, s = after[j], after[after[j]]
            turn = df[one][r] * f[two][s] + f[one][r] * df[two][s] - df[one][s] * f[two][r] - f[one][s] * df[two][r]
            row.append(shear * df[i][j] + stretch * f[i][j] + along * cof[i][j] + bulk * turn)
        p.append(row)
    return torch.stack(_at_corners(p, c), 1)
