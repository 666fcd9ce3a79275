"""The hard patches of all plans brought to equilibrium together, while the rest of the mesh stays.

As :mod:`pinnochio.mechanics.solvers.local_equilibrium`, but Newton's systems are solved by conjugate gradients, many
small systems that never have to be assembled, and sliding nodes move in their tangent planes: they are put back on
their bones afterwards, and steps of the whole are as few as with the bend of the bones in the tangent [X]. Where the
energy bends downwards, the tangent is damped instead: of every element the bulk's part that bends it (the only one
without a sign) is bounded so that the whole is positive definite. Here for a CPU; on a GPU
:mod:`pinnochio.mechanics.solvers.batched.hard_patches_gpu`.
"""

import numpy as np
import torch
from scipy import sparse
from torch import Tensor

from pinnochio.mechanics.elements.tetrahedra import RELATIVE_ROUND_OFF, Elements
from pinnochio.mechanics.solvers.batched.batch_energy import BatchElements, BatchState, cofactor, damped, determinant
from pinnochio.mechanics.solvers.batched.sparse_rows import SparseRows, fused
from pinnochio.mechanics.solvers.local_equilibrium import subset
from pinnochio.mechanics.solvers.newton import UNTANGLING

STEPS = 10  # of Newton's method, at most, before a step of the whole is judged; as many to untangle
GRADIENTS = 48  # iterations of conjugate gradients in a step of Newton's method, at most [X]
FORCING = 0.1  # residual of a Newton system that is enough, relative [X]
SHARES = 4  # of a step that are tried, 1, 0.3, 0.09 and so on: the first that lowers the energy is taken


class PatchNeighbours:
    """Which patches touch which nodes of a mesh; free (n,) bool: nodes that move."""

    def __init__(self, elements: Elements, free, device):
        corners = np.repeat(elements.patch, 4), elements.cells.ravel()
        touch = sparse.csr_array((np.ones(elements.cells.size), corners), (len(elements.patch_volumes), elements.nodes))
        self._touch, self._touched = (SparseRows(item, device, torch.float32) for item in (touch, touch.T))
        self._free = torch.as_tensor(free, device=device)[:, None]

    def wide(self, patches: Tensor) -> Tensor:
        """Patches (p, k) bool with those that touch them."""
        return self._touch((self._touched(patches.float()) > 0).float()) > 0

    def around(self, patches: Tensor) -> tuple[Tensor, Tensor]:
        """The nodes (n, k) of patches (p, k) that move, and all patches (p, k) whose energy that changes."""
        moves = (self._touched(patches.float()) > 0) & self._free
        return moves, self._touch(moves.float()) > 0


class HardPatches(PatchNeighbours):
    """Hard patches of some plans, on a CPU."""

    def __init__(self, elements: Elements, free, plans: int, device):
        super().__init__(elements, free, device)
        self._elements, self._device = elements, device
        self._noise = elements.round_off
        self._extension, self._nodes = elements.material.extension, torch.zeros(0, dtype=torch.long)
        self.open = torch.zeros(plans, dtype=torch.bool)  # plans whose patches are on their way, of which none is left

    def prepare(self, known: Tensor) -> None:
        """Take known (p, k) bool as the hard patches of the plans."""
        moves, touched = self.around(known)
        chosen = touched.any(1).numpy()
        part, nodes = subset(self._elements, chosen)
        self._members = touched[chosen][part.patch]  # elements (m, k) of each plan
        self._fine, self._coarse = BatchElements(part, self._device), BatchElements(part, self._device, torch.float32)
        self._nodes = torch.as_tensor(nodes, device=self._device)
        self._moves = moves[self._nodes][:, None]

    def settle(self, u: Tensor, across: Tensor, goal: Tensor, lowest: Tensor, running: Tensor) -> None:
        """Move the hard patches of displacements u (n, 3, k) mm until their force is at most goal (k,) mN, or as long
        as that helps, of plans (k,) bool that run and have no J below lowest (k,).

        across (n, 3, k): normals of sliding nodes, which move across them alone; zero at all others.
        """
        if not len(self._nodes):
            return
        field, law, self._across = u[self._nodes], torch.full_like(goal, self._extension), across[self._nodes]
        least = self._least(self._fine.measure(field, law))
        extension = torch.where(least > 0, law, UNTANGLING)
        works, left = running & (least >= lowest), torch.full_like(goal, STEPS)
        while works.any():
            share, motion = self._step(field, extension, torch.where(works & (left > 0), goal, torch.inf))
            field = field + share * motion
            stuck = share == 0
            works &= ~stuck | (extension != law)
            left = torch.where(stuck, STEPS, left - 1)
            # What was untangled, with ln J extended far, goes on by its own law; what was not is given up.
            loose, extension = extension != law, torch.where(stuck, law, extension)
            if (stuck & loose).any():
                least = self._least(self._fine.measure(field, law))
                works &= ~(stuck & loose) | (least > 0) | (lowest == -torch.inf)
        u[self._nodes] = field

    def _step(self, field: Tensor, extension: Tensor, goal: Tensor) -> tuple[Tensor, Tensor]:
        """Share (k,), 0 where none is wanted or serves, and motion (n, 3, k) mm of a Newton step."""
        state = self._fine.measure(field, extension)
        force = _level(torch.where(self._moves, state.force, 0), self._across)
        wanting = torch.linalg.vector_norm(force, dim=(0, 1)) > goal
        if not wanting.any():
            return torch.zeros_like(goal), force
        motion = self._direction(field, state, torch.where(wanting, force, 0), extension).double()
        slope = (motion * force).sum((0, 1))
        barrier = torch.where(self._least(state) > 0, 0.0, -torch.inf).double()
        noise = self._noise + RELATIVE_ROUND_OFF * state.energy.abs()
        share = torch.zeros_like(state.energy)
        for part in 0.3 ** np.arange(SHARES):
            ahead = self._fine.measure(field + part * motion, extension)
            good = (ahead.energy <= state.energy + 1e-4 * part * slope + noise) & (self._least(ahead) > barrier)
            share = torch.where(good & (share == 0), part, share)
        return torch.where(wanting, share, 0.0), motion

    def _least(self, state: BatchState) -> Tensor:
        """Least J (k,) of each plan's own elements."""
        return torch.where(self._members, state.ratio, torch.inf).amin(0)

    def _direction(self, field, state, force, extension) -> Tensor:
        coarse = field.float()
        second = state.second.float()
        kept, blocks = self._coarse.curvature(
            coarse, state._replace(first=state.first.float(), second=second), extension.float()
        )
        inverse = _inverted(blocks, self._across.float())
        residual = -force.float()
        z = _applied(inverse, residual, self._moves)
        begin = torch.zeros_like(residual), residual, z, (residual * z).sum((0, 1))
        motion, residual, way, size = begin
        least = FORCING**2 * size
        active, tame = size > 0, torch.zeros_like(size, dtype=torch.bool)
        for _ in range(GRADIENTS):
            image = torch.where(self._moves, self._coarse.product(kept, second, way), 0)
            curvature = (way * image).sum((0, 1))
            bad = active & ~(curvature > 0)
            active = active & (~bad | ~tame)
            share = torch.where(active & ~bad, size / curvature, 0)
            motion, residual, z = _advanced(motion, residual, way, image, share, inverse, self._moves)
            new = (residual * z).sum((0, 1))
            way = torch.where(active, z + new / size * way, way)
            size = torch.where(active, new, size)
            if bad.any():
                again = bad & ~tame
                kept, second = (
                    torch.where(again, *both) for both in zip(damped(kept, second), (kept, second), strict=True)
                )
                motion, residual, way, size = (
                    torch.where(again, *both) for both in zip(begin, (motion, residual, way, size), strict=True)
                )
                tame |= again
            active = active & (size > least)
            if not active.any():
                break
        return motion


def _level(vectors, across):
    """Vectors (n, 3, k) without their parts along normals (n, 3, k)."""
    return vectors - across * (across * vectors).sum(1, keepdim=True)


@fused
def _inverted(blocks, across):
    """Inverses of symmetric blocks (n, 9, k) between what lies across normals (n, 3, k)."""
    a = [[blocks[:, 3 * i + j] for j in range(3)] for i in range(3)]
    c = cofactor(a)
    det = determinant(a, c)
    det = torch.where(det > 0, det, torch.inf)
    inverse = torch.stack([_level(torch.stack([c[j][i] / det for j in range(3)], 1), across) for i in range(3)], 1)
    return torch.stack([_level(inverse[:, :, j], across) for j in range(3)], 2).flatten(1, 2)


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
