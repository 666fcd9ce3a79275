"""The equilibrium residual in torch: the energy of `elements`, for losses, metrics and networks."""

from dataclasses import dataclass

import numpy as np
import torch

from pinnochio.mechanics.elements import Elements
from pinnochio.mechanics.materials import EXTENSION, Material


@dataclass(frozen=True)
class Operator:
    """Energy, internal force and stiffness of one mesh as functions of its displacement (n, 3) in mm.

    Everything but `diagonal_blocks` is differentiable, finite at and past inversion, and adds in float64 exactly what
    the compiled kernels add. h_ref: mean edge length in mm; mu_ref: mean mu in kPa; mu_ref h_ref^2 is the force in mN
    by which the physics loss is divided (methods.md 4.4).
    """

    cells: torch.Tensor
    gradients: torch.Tensor
    volumes: torch.Tensor
    node_volumes: torch.Tensor
    mu: torch.Tensor
    lam: torch.Tensor
    stiffening: torch.Tensor
    node_lam: torch.Tensor
    averaged: bool
    extension: float
    h_ref: float
    mu_ref: float

    @classmethod
    def build(
        cls,
        points,
        cells,
        mu,
        lam,
        stiffening,
        volumetric: str = "anp",
        dtype: torch.dtype = torch.float64,
        device: torch.device | str = "cpu",
        extension: float = EXTENSION,
    ) -> "Operator":
        """Operator of a mesh, points (n, 3) mm, cells (m, 4), constants (m,) kPa; measured in float64, then cast."""
        mesh = Elements.build(points, cells, Material(mu, lam, stiffening, extension), volumetric)
        node_volumes = np.where(mesh.node_volumes > 0, mesh.node_volumes, 1)
        reals = (mesh.gradients, mesh.volumes, node_volumes, mu, lam, stiffening, mesh.node_lam)
        tensors = [torch.as_tensor(np.asarray(x), dtype=dtype, device=device) for x in reals]
        return cls(
            torch.as_tensor(mesh.cells, dtype=torch.long, device=device),
            *tensors,
            averaged=mesh.averaged,
            extension=extension,
            h_ref=mesh.edge,
            mu_ref=mesh.modulus,
        )

    def jacobians(self, u: torch.Tensor) -> torch.Tensor:
        """det F (m,) of every element."""
        return self._strain(u)[2]

    def energy(self, u: torch.Tensor) -> torch.Tensor:
        """Strain energy, a scalar in mN mm, zero at rest."""
        _, _, j, excess = self._strain(u)
        log, _, _ = self._log(j)
        density = self.mu / 2 * excess + self.stiffening / 2 * excess**2 - self.mu * log
        if self.averaged:
            nodal = self._log(self._node_ratio(j))[0]
            return (self.volumes * density).sum() + (self.node_volumes * self.node_lam / 2 * nodal**2).sum()
        return (self.volumes * (density + self.lam / 2 * log**2)).sum()

    def force(self, u: torch.Tensor) -> torch.Tensor:
        """Internal force (n, 3) in mN, the gradient of the energy; zero on free nodes in equilibrium."""
        f, cofactor, j, excess = self._strain(u)
        log, slope, _ = self._log(j)
        if self.averaged:
            nodal, nodal_slope, _ = self._log(self._node_ratio(j))
            pressure = (self.node_lam * nodal * nodal_slope)[self.cells].mean(dim=1)
        else:
            pressure = self.lam * log * slope
        shear = self.mu + 2 * self.stiffening * excess
        stress = shear[:, None, None] * f + (pressure - self.mu * slope)[:, None, None] * cofactor
        corner = torch.einsum("e,eij,eaj->eai", self.volumes, stress, self.gradients)
        return torch.zeros_like(u).index_add(0, self.cells.reshape(-1), corner.reshape(-1, 3))

    @torch.no_grad()
    def diagonal_blocks(self, u: torch.Tensor) -> torch.Tensor:
        """Diagonal blocks (n, 3, 3) of the tangent in mN/mm, for block-Jacobi scaling."""
        f, cofactor, j, excess = self._strain(u)
        log, slope, curve = self._log(j)
        fg = torch.einsum("eij,eaj->eai", f, self.gradients)
        cg = torch.einsum("eij,eaj->eai", cofactor, self.gradients)
        shear = (self.mu + 2 * self.stiffening * excess)[:, None] * (self.gradients**2).sum(dim=2)
        bulk = -self.mu * curve
        if not self.averaged:
            bulk = bulk + self.lam * (slope**2 + log * curve)
        corner = shear[:, :, None, None] * torch.eye(3, dtype=u.dtype, device=u.device)
        corner = corner + 4 * self.stiffening[:, None, None, None] * fg[:, :, :, None] * fg[:, :, None, :]
        corner = corner + bulk[:, None, None, None] * cg[:, :, :, None] * cg[:, :, None, :]
        corner = corner * self.volumes[:, None, None, None]
        blocks = torch.zeros(len(u), 3, 3, dtype=u.dtype, device=u.device)
        blocks.index_add_(0, self.cells.reshape(-1), corner.reshape(-1, 3, 3))
        if self.averaged:
            log, slope, curve = self._log(self._node_ratio(j))
            stiffness = self.node_lam * (slope**2 + log * curve) / self.node_volumes
            # b[a, c] = V_a dJ_a/du_c gathers over the elements that the nodes a and c share.
            pairs = (self.cells[:, :, None] * len(u) + self.cells[:, None, :]).reshape(-1)
            pairs, place = torch.unique(pairs, return_inverse=True)
            shares = (self.volumes / 4)[:, None, None, None] * cg[:, None].expand(-1, 4, -1, -1)
            b = torch.zeros(len(pairs), 3, dtype=u.dtype, device=u.device)
            b.index_add_(0, place, shares.reshape(-1, 3))
            outer = stiffness[pairs // len(u)][:, None, None] * b[:, :, None] * b[:, None, :]
            blocks.index_add_(0, pairs % len(u), outer)
        return blocks

    def _strain(self, u):
        """F and its cofactor (m, 3, 3), J and I1 - 3 (m,); the last without cancellation near rest."""
        h = torch.einsum("eai,eaj->eij", u[self.cells], self.gradients)
        f = h + torch.eye(3, dtype=u.dtype, device=u.device)
        rows = f.unbind(dim=1)
        cross = [torch.linalg.cross(rows[(i + 1) % 3], rows[(i + 2) % 3]) for i in range(3)]
        cofactor = torch.stack(cross, dim=1)
        excess = (h**2).sum(dim=(1, 2)) + 2 * h.diagonal(dim1=1, dim2=2).sum(dim=1)
        return f, cofactor, (rows[0] * cross[0]).sum(dim=1), excess

    def _node_ratio(self, j):
        corner = (self.volumes / 4 * j)[:, None].expand(-1, 4).reshape(-1)
        total = torch.zeros_like(self.node_volumes).index_add(0, self.cells.reshape(-1), corner)
        return total / self.node_volumes

    def _log(self, j):
        """ln J and its first two derivatives, extended below `extension` by the Taylor polynomial there."""
        eps = self.extension
        safe = j.clamp(min=eps)  # keeps the unused branch of torch.where finite, and so its gradient
        d = (j - eps) / eps
        inside = j >= eps
        log = torch.where(inside, safe.log(), float(np.log(eps)) + d - d**2 / 2)
        slope = torch.where(inside, 1 / safe, (1 - d) / eps)
        return log, slope, torch.where(inside, -1 / safe**2, torch.full_like(j, -1 / eps**2))
