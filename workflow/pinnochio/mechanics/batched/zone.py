"""The hard patches of all plans brought to equilibrium together, while the rest of the mesh stays.

As :mod:`pinnochio.mechanics.local_equilibrium`, but Newton's systems are solved by conjugate gradients: many small
systems that never have to be assembled. Here for a CPU; on a GPU :mod:`pinnochio.mechanics.batched.zone_gpu`.
"""

import numpy as np
import torch
from scipy import sparse
from torch import Tensor

from pinnochio.mechanics.batched.law import Mesh, State, cofactor, determinant
from pinnochio.mechanics.batched.rows import Rows, fused
from pinnochio.mechanics.elements import Elements
from pinnochio.mechanics.local_equilibrium import subset
from pinnochio.mechanics.solver import UNTANGLING

STEPS = 2  # of Newton's method before a step of the whole is judged, at most
GRADIENTS = 20  # iterations of conjugate gradients in a step of Newton's method [X]
FORCING = 0.1  # residual of a Newton system that is enough, relative [X]
SHARES = 1.0, 0.4, 0.1  # of a step, of which the first that lowers the energy is taken


class Patches:
    """Which patches touch which nodes of a mesh; free (n,) bool: nodes that move."""

    def __init__(self, elements: Elements, free, device):
        corners = np.repeat(elements.patch, 4), elements.cells.ravel()
        touch = sparse.csr_array((np.ones(elements.cells.size), corners), (len(elements.patch_volumes), elements.nodes))
        self._touch, self._touched = (Rows(item, device, torch.float32) for item in (touch, touch.T))
        self._free = torch.as_tensor(free, device=device)[:, None]

    def wide(self, patches: Tensor) -> Tensor:
        """Patches (p, k) bool with those that touch them."""
        return self._touch((self._touched(patches.float()) > 0).float()) > 0

    def around(self, patches: Tensor) -> tuple[Tensor, Tensor]:
        """The nodes (n, k) of patches (p, k) that move, and all patches (p, k) whose energy that changes."""
        moves = (self._touched(patches.float()) > 0) & self._free
        return moves, self._touch(moves.float()) > 0


class Zone(Patches):
    """Hard patches of some plans, on a CPU."""

    def __init__(self, elements: Elements, free, plans: int, device):
        super().__init__(elements, free, device)
        self._elements, self._device = elements, device
        self._noise = 1e-14 * elements.modulus * elements.volumes.sum()
        self._extension, self._nodes = elements.material.extension, torch.zeros(0, dtype=torch.long)

    def prepare(self, known: Tensor) -> None:
        """Take known (p, k) bool as the hard patches of the plans."""
        moves, touched = self.around(known)
        chosen = touched.any(1).numpy()
        own, nodes = subset(self._elements, chosen)
        self._own = touched[chosen][own.patch]  # elements (m, k) of each plan
        self._fine, self._coarse = Mesh(own, self._device), Mesh(own, self._device, torch.float32)
        self._nodes = torch.as_tensor(nodes, device=self._device)
        self._moves = moves[self._nodes][:, None]

    def settle(self, u: Tensor, goal: Tensor) -> None:
        """Move hard patches of displacements u (n, 3, k) mm until their force is at most goal (k,) mN, or as long as
        that helps."""
        if not len(self._nodes):
            return
        field = u[self._nodes]
        law = torch.full_like(goal, self._extension)
        least = self._least(self._fine.measure(field, law))
        extension = torch.where(least > 0, law, UNTANGLING)
        done = torch.zeros_like(least, dtype=torch.bool)
        for _ in range(STEPS):
            new, wanted, ended = self._step(field, extension, goal)
            field = torch.where(done, field, new)
            extension, done = wanted, done | ended
            if done.all():
                break
        u[self._nodes] = field

    def _step(self, field: Tensor, extension: Tensor, goal: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """The field and the extension after a Newton step, and which plans (k,) had no need of one.

        What was untangled, with ln J extended far, goes on by its own law.
        """
        state = self._fine.measure(field, extension)
        force = torch.where(self._moves, state.force, 0)
        wanting = torch.linalg.vector_norm(force, dim=(0, 1)) > goal
        motion = self._direction(field, state, force, extension).double()
        slope = (motion * force).sum((0, 1))
        barrier = torch.where(self._least(state) > 0, 0.0, -torch.inf).double()
        share = torch.zeros_like(state.energy)
        for part in SHARES:
            ahead = self._fine.measure(field + part * motion, extension)
            noise = self._noise + 1e-13 * state.energy.abs()
            good = (ahead.energy <= state.energy + 1e-4 * part * slope + noise) & (self._least(ahead) > barrier)
            share = torch.where(good & (share == 0), part, share)
        share = torch.where(wanting, share, 0.0)
        stuck = share == 0
        done = stuck & (extension == self._extension)
        return field + share * motion, torch.where(stuck, self._extension, extension), done

    def _least(self, state: State) -> Tensor:
        """Least J (k,) of each plan's own elements."""
        return torch.where(self._own, state.ratio, torch.inf).amin(0)

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
            if not active.any():
                break
        return motion


@fused
def _inverted(blocks):
    """Inverses of symmetric blocks (n, 9, k)."""
    a = [[blocks[:, 3 * i + j] for j in range(3)] for i in range(3)]
    c = cofactor(a)
    det = determinant(a, c)
    det = torch.where(det > 0, det, torch.inf)
    return torch.stack([c[j][i] / det for i in range(3) for j in range(3)], 1)


@fused
def _applied(inverse, x, moves):
    return _times(inverse, x, moves)


@fused
def _advanced(motion, residual, way, image, share, inverse, moves):
    motion, residual = motion + share * way, residual - share * image
    return motion, residual, _times(inverse, residual, moves)


def _times(inverse, x, moves):
    """Blocks (n, 9, k) times vectors (n, 3, k), zero where nothing moves."""
    rows = [sum(inverse[:, 3 * i + j] * x[:, j] for j in range(3)) for i in range(3)]
    return torch.where(moves, torch.stack(rows, 1), 0)
