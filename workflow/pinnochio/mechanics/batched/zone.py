"""The hard patches of all plans brought to equilibrium together, while the rest of the mesh stays.

As :mod:`pinnochio.mechanics.local_equilibrium`, but for one set of patches that all plans share, and with Newton's
systems solved by conjugate gradients: many small systems that never have to be assembled.
"""


import numpy as np
import torch
from torch import Tensor

from pinnochio.mechanics.batched.law import Mesh
from pinnochio.mechanics.batched.rows import fused
from pinnochio.mechanics.elements import Elements
from pinnochio.mechanics.local_equilibrium import subset
from pinnochio.mechanics.solver import UNTANGLING

GRADIENTS = 20  # iterations of conjugate gradients in a step of Newton's method [X]
FORCING = 0.03  # residual of a Newton system that is enough, relative [X]
SHARES = 1.0, 0.4, 0.1  # of a step, from which the one of least energy is taken


class Zone:
    """Patches (p,) bool of a mesh, whose free nodes move; free (n,) bool."""

    def __init__(self, elements: Elements, patches, free, device):
        moving = np.zeros(elements.nodes, bool)
        moving[elements.cells[patches[elements.patch]]] = True
        moving &= free
        touched = np.zeros(len(patches), bool)
        touched[elements.patch[moving[elements.cells].any(axis=1)]] = True
        own, nodes = subset(elements, touched)
        # In the order of the patches, neighbouring lanes read neighbouring elements.
        self._fine, self._coarse = Mesh(own, device), Mesh(own, device, torch.float32)
        self.nodes = torch.as_tensor(nodes, device=device)
        self._moves = torch.as_tensor(moving[nodes], device=device)[:, None, None]
        self._noise = 1e-14 * own.modulus * own.volumes.sum()
        self._extension = own.material.extension

    def begin(self, u: Tensor) -> tuple[Tensor, Tensor]:
        """The zone's part of displacements (n, 3, k), and the extension (k,) of ln J that each needs."""
        field = u[self.nodes]
        law = torch.full_like(field[0, 0], self._extension)
        _, least = self._fine.energy(field, law)
        return field, torch.where(least > 0, law, UNTANGLING)

    def step(self, field: Tensor, extension: Tensor, goal: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """The field and the extension after a Newton step, and which plans (k,) had no need of one.

        goal (k,) mN: norm of the force that is enough. What was untangled goes on by its own law.
        """
        state = self._fine.measure(field, extension)
        force = torch.where(self._moves, state.force, 0)
        wanting = torch.linalg.vector_norm(force, dim=(0, 1)) > goal
        motion = self._direction(field, state, force, extension).double()
        slope = (motion * force).sum((0, 1))
        barrier = torch.where(state.ratio.amin(0) > 0, 0.0, -torch.inf).double()
        best, share = state.energy, torch.zeros_like(state.energy)
        for part in SHARES:
            energy, least = self._fine.energy(field + part * motion, extension)
            noise = self._noise + 1e-13 * state.energy.abs()
            good = (energy <= best.clamp(max=state.energy + 1e-4 * part * slope + noise)) & (least > barrier)
            best, share = torch.where(good, energy, best), torch.where(good, part, share)
        share = torch.where(wanting, share, 0.0)
        stuck = share == 0
        done = stuck & (extension == self._extension)
        return field + share * motion, torch.where(stuck, self._extension, extension), done

    def _direction(self, field, state, force, extension) -> Tensor:
        coarse = field.float()
        second = state.second.float()
        kept, blocks = self._coarse.curvature(
            coarse, state._replace(first=state.first.float(), second=second), extension.float()
        )
        inverse = _inverted(blocks)
        residual = -force.float()
        z = _applied(inverse, residual, self._moves)
        motion, way = torch.zeros_like(residual), z
        size = (residual * z).sum((0, 1))
        least = FORCING**2 * size
        active = size > 0
        for _ in range(GRADIENTS):
            image = torch.where(self._moves, self._coarse.product(kept, second, way), 0)
            bend = (way * image).sum((0, 1))
            # Where the energy bends downwards, the way so far serves, or the first one.
            motion = torch.where(active & ~(bend > 0) & (motion == 0).all(1).all(0), way, motion)
            active = active & (bend > 0)
            share = torch.where(active, size / bend, 0)
            motion, residual, z = _advanced(motion, residual, way, image, share, inverse, self._moves)
            new = (residual * z).sum((0, 1))
            way = torch.where(active, z + new / size * way, way)
            size = torch.where(active, new, size)
            active = active & (new > least)
            if not motion.is_cuda and not active.any():
                break
        return motion


@fused
def _inverted(blocks):
    """Inverses of symmetric blocks (n, 9, k)."""
    a = [[blocks[:, 3 * i + j] for j in range(3)] for i in range(3)]
    c = [[a[(i + 1) % 3][(j + 1) % 3] * a[(i + 2) % 3][(j + 2) % 3]
          - a[(i + 1) % 3][(j + 2) % 3] * a[(i + 2) % 3][(j + 1) % 3] for j in range(3)] for i in range(3)]  # fmt: skip
    det = a[0][0] * c[0][0] + a[0][1] * c[0][1] + a[0][2] * c[0][2]
    det = torch.where(det > 0, det, torch.inf)
    return torch.stack([c[j][i] / det for i in range(3) for j in range(3)], 1)


@fused
def _applied(inverse, x, moves):
    rows = [sum(inverse[:, 3 * i + j] * x[:, j] for j in range(3)) for i in range(3)]
    return torch.where(moves, torch.stack(rows, 1), 0)


@fused
def _advanced(motion, residual, way, image, share, inverse, moves):
    motion, residual = motion + share * way, residual - share * image
    rows = [sum(inverse[:, 3 * i + j] * residual[:, j] for j in range(3)) for i in range(3)]
    return motion, residual, torch.where(moves, torch.stack(rows, 1), 0)
