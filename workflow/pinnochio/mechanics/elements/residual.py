"""The equilibrium residual in torch: the energy of `elements`, for losses and networks."""

from dataclasses import dataclass

import numpy as np
import torch

from pinnochio.mechanics.elements.materials import Material
from pinnochio.mechanics.elements.tetrahedra import VOLUMETRIC, Elements


@dataclass(frozen=True)
class Operator:
    """Energy and internal force of one mesh as functions of its displacement (n, 3) in mm.

    Everything is differentiable, finite at and past inversion, and adds in float64 exactly what the compiled kernels
    add. h_ref: mean edge length in mm; mu_ref: mean mu in kPa; mu_ref h_ref^2 is the force in mN by which the physics
    loss is divided (methods.md 4.4).
    """

    cells: torch.Tensor
    patch: torch.Tensor
    gradients: torch.Tensor
    volumes: torch.Tensor
    patch_volumes: torch.Tensor
    mu: torch.Tensor
    patch_lam: torch.Tensor
    stiffening: torch.Tensor
    extension: float
    h_ref: float
    mu_ref: float

    @classmethod
    def build(
        cls,
        points,
        cells,
        material: Material,
        volumetric: str = VOLUMETRIC[0],
        dtype: torch.dtype = torch.float64,
        device: torch.device | str = "cpu",
    ) -> "Operator":
        """Operator of a mesh, points (n, 3) mm and cells (m, 4); measured in float64, then cast."""
        mesh = Elements.build(points, cells, material, volumetric)
        integers = [torch.as_tensor(x, dtype=torch.long, device=device) for x in (mesh.cells, mesh.patch)]
        reals = (mesh.gradients, mesh.volumes, mesh.patch_volumes, material.mu, mesh.patch_lam, material.stiffening)
        tensors = [torch.as_tensor(np.asarray(x), dtype=dtype, device=device) for x in reals]
        return cls(*integers, *tensors, extension=material.extension, h_ref=mesh.edge, mu_ref=mesh.modulus)

    @property
    def force_scale(self) -> float:
        """mN by which the physics loss divides: mean shear modulus times mean edge length squared."""
        return self.mu_ref * self.h_ref**2

    def jacobians(self, u: torch.Tensor) -> torch.Tensor:
        """det F (m,) of every element."""
        return self._strain(u)[2]

    def energy(self, u: torch.Tensor) -> torch.Tensor:
        """Strain energy, a scalar in mN mm, zero at rest."""
        _, _, j, excess = self._strain(u)
        density = self.mu / 2 * excess + self.stiffening / 2 * excess**2 - self.mu * self._log(j)[0]
        bulk = self.patch_lam / 2 * self._log(self._patch_ratio(j))[0] ** 2
        return (self.volumes * density).sum() + (self.patch_volumes * bulk).sum()

    def force(self, u: torch.Tensor) -> torch.Tensor:
        """Internal force (n, 3) in mN, the gradient of the energy; zero on free nodes in equilibrium."""
        f, cofactor, j, excess = self._strain(u)
        slope = self._log(j)[1]
        log, patch_slope = self._log(self._patch_ratio(j))
        pressure = (self.patch_lam * log * patch_slope)[self.patch]
        shear = self.mu + 2 * self.stiffening * excess
        stress = shear[:, None, None] * f + (pressure - self.mu * slope)[:, None, None] * cofactor
        corner = torch.einsum("e,eij,eaj->eai", self.volumes, stress, self.gradients)
        return torch.zeros_like(u).index_add(0, self.cells.reshape(-1), corner.reshape(-1, 3))

    def _strain(self, u):
        """F and its cofactor (m, 3, 3), J and I1 - 3 (m,); the last without cancellation near rest."""
        h = torch.einsum("eai,eaj->eij", u[self.cells], self.gradients)
        f = h + torch.eye(3, dtype=u.dtype, device=u.device)
        rows = f.unbind(dim=1)
        cross = [torch.linalg.cross(rows[(i + 1) % 3], rows[(i + 2) % 3]) for i in range(3)]
        cofactor = torch.stack(cross, dim=1)
        excess = (h**2).sum(dim=(1, 2)) + 2 * h.diagonal(dim1=1, dim2=2).sum(dim=1)
        return f, cofactor, (rows[0] * cross[0]).sum(dim=1), excess

    def _patch_ratio(self, j):
        return torch.zeros_like(self.patch_volumes).index_add(0, self.patch, self.volumes * j) / self.patch_volumes

    def _log(self, j):
        """ln J and its derivative, extended below `extension` by the Taylor polynomial there."""
        eps = self.extension
        safe = j.clamp(min=eps)  # keeps the unused branch of torch.where finite, and so its gradient
        d = (j - eps) / eps
        inside = j >= eps
        log = torch.where(inside, safe.log(), float(np.log(eps)) + d - d**2 / 2)
        return log, torch.where(inside, 1 / safe, (1 - d) / eps)
