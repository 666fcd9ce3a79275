"""A part of a mesh brought to equilibrium while the rest of it stays: Newton's method on whole patches."""

from dataclasses import replace

import numpy as np

from pinnochio.mechanics.assembly import CUT, Assembler
from pinnochio.mechanics.constraints import Constraints
from pinnochio.mechanics.elements import Elements
from pinnochio.mechanics.linear import linear_solver
from pinnochio.mechanics.materials import Material
from pinnochio.mechanics.solver import UNTANGLING

# Way of a sliding node in mean edges after which the rest of the mesh has to follow first: alone, some nodes slid over
# the rim of the bone and stayed there [X].
SLIDE = 0.2
STEPS = 10  # Newton iterations at most in one call [I]


def subset(elements: Elements, chosen) -> tuple[Elements, np.ndarray]:
    """The elements of the patches `chosen` (p,) bool as a mesh of their own, and the nodes of it, ascending."""
    kept = np.flatnonzero(chosen[elements.patch])
    nodes, cells = np.unique(elements.cells[kept], return_inverse=True)
    law, number = elements.material, np.cumsum(chosen) - 1
    return replace(
        elements,
        cells=cells.reshape(-1, 4).astype(np.int32),
        gradients=elements.gradients[kept],
        volumes=elements.volumes[kept],
        patch=number[elements.patch[kept]].astype(np.int32),
        patch_volumes=elements.patch_volumes[chosen],
        patch_lam=elements.patch_lam[chosen],
        material=Material(law.mu[kept], law.lam[kept], law.stiffening[kept], law.extension),
        nodes=len(nodes),
    ), nodes


class LocalEquilibrium:
    """Some patches of a mesh, whose nodes alone move.

    patches (p,) bool: those to bring to equilibrium; sliding nodes are among their nodes all or none. inside (n, 3)
    bool: the unknowns that move. Every patch beside them belongs to the energy.
    """

    def __init__(self, elements: Elements, constraints: Constraints, patches, kind: str):
        self.patches = patches
        moving = np.zeros(elements.nodes, bool)
        moving[elements.cells[patches[elements.patch]]] = True
        self.inside = ~constraints.constrained & moving[:, None]
        touched = np.zeros(len(patches), bool)
        touched[elements.patch[self.inside.any(axis=1)[elements.cells].any(axis=1)]] = True
        self._elements, self._nodes = subset(elements, touched)
        self._slides = bool(len(constraints.sliding.nodes)) and bool(self.inside[constraints.sliding.nodes].any())
        framed = constraints.sliding.nodes if self._slides else np.zeros(0, int)
        self._framed = np.searchsorted(self._nodes, framed)
        self._assembler = Assembler(self._elements, ~self.inside[self._nodes], self._framed)
        self._linear = linear_solver(self._assembler.indptr, self._assembler.indices, 0, kind)

    def settled(self, u, constraints: Constraints, goal: float, axes) -> tuple[np.ndarray, int]:
        """The displacement (n, 3) with the part in equilibrium, or nearer to it, and the Newton iterations made.

        goal: norm of the free forces that is enough, mN; axes: displacement (n, 3) -> local axes of sliding nodes.
        """
        made, self._indefinite, elements = 0, False, self._elements
        inverted = elements.evaluate(u[self._nodes])[2] <= 0
        if inverted:
            u, made = self._newton(u, elements.with_extension(UNTANGLING), constraints, goal, axes, -np.inf)
            inverted = elements.evaluate(u[self._nodes])[2] <= 0
        u, more = self._newton(u, elements, constraints, goal, axes, -np.inf if inverted else 0.0)
        return u, made + more

    def _newton(self, u, elements: Elements, constraints: Constraints, goal: float, axes, least_allowed: float):
        sliding, none = constraints.sliding, np.zeros((0, 3, 3))
        energy, force, _ = elements.evaluate(u[self._nodes])
        for step in range(STEPS):
            frames = axes(u) if self._slides else none
            free = self._assembler.gather(self._local(force, frames))
            if np.linalg.norm(free) <= goal:
                return u, step
            motion = self._direction(u, elements, sliding, frames, force, free)
            if motion is None:
                return u, step
            slope = -float(np.vdot(motion, force))
            slide = np.linalg.norm(motion[self._framed], axis=1).max(initial=0.0)
            share = min(1.0, SLIDE * elements.edge / max(slide, 1e-30))
            far = share < 1
            noise = 1e-14 * elements.modulus * elements.volumes.sum() + 1e-13 * abs(energy)
            while share > 1e-4:
                new = u.copy()
                new[self._nodes] += share * motion
                if self._slides:
                    new = sliding.project(new, 1.0)
                new_energy, new_force, least = elements.evaluate(new[self._nodes])
                if least > least_allowed and new_energy <= energy - 1e-4 * share * slope + noise:
                    break
                share /= 2
            else:
                return u, step
            u, energy, force = new, new_energy, new_force
            if far:
                return u, step + 1
        return u, STEPS

    def _direction(self, u, elements, sliding, frames, force, free) -> np.ndarray | None:
        """Newton's step (k, 3) of the part's nodes, of the tangent without negative eigenvalues if need be."""
        for definite in (CUT,) if self._indefinite else (0.0, CUT):
            data, _ = self._assembler.tangent(u[self._nodes], frames, definite=definite, elements=elements)
            if self._slides and not definite:
                whole = np.zeros(u.shape)
                whole[self._nodes] = force
                bend = sliding.curvature(u, 1.0, frames, whole)
                self._assembler.add(data, np.repeat(self._framed[:, None], 2, axis=1), bend)
            if self._linear.factorize(data):
                local = self._assembler.scatter(-self._linear.solve(free))
                local[self._framed] = np.einsum("sij,si->sj", frames, local[self._framed])
                return local
            self._indefinite = True
        return None

    def _local(self, vectors, frames) -> np.ndarray:
        turned = np.array(vectors)
        turned[self._framed] = np.einsum("sij,sj->si", frames, turned[self._framed])
        return turned

    def close(self) -> None:
        """Release the factors."""
        self._linear.close()
