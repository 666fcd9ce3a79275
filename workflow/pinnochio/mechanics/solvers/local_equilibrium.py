"""A part of a mesh brought to equilibrium while the rest of it stays: Newton's method on whole patches, whose factors
are kept as long as they serve."""

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from pinnochio.geometry.mesh_topology import compacted
from pinnochio.mechanics.boundary.constraints import turned
from pinnochio.mechanics.boundary.loads import OuterForces
from pinnochio.mechanics.boundary.sliding import SlidingNodes
from pinnochio.mechanics.elements.assembly import Assembler
from pinnochio.mechanics.elements.materials import Material
from pinnochio.mechanics.elements.tetrahedra import Elements
from pinnochio.mechanics.solvers.linear_algebra import linear_solver
from pinnochio.mechanics.solvers.newton import UNTANGLING

SLIDE = 0.5  # way of a sliding node in mean edges that a step is shortened to [I]
STEPS = 10  # iterations at most in one call [I]
SLOW = 0.5  # factors that leave more of the force than this are made anew [X]
# Where the force is that of so small a share of the nodes, all others having less than QUIET of what is enough, the
# patches about these come to equilibrium by themselves first: an element that turns does not cost steps of all [X].
QUIET, FEW = 0.5, 0.1
SMALL = 0.25  # share of the patches from which on factors of their own do not pay [I]


def touching(elements: Elements, nodes) -> np.ndarray:
    """Patches (p,) bool of which an element has one of the nodes, (k,) or (n,) bool."""
    there, patches = np.zeros(elements.nodes, bool), np.zeros(len(elements.patch_volumes), bool)
    there[nodes] = True
    patches[elements.patch[there[elements.cells].any(axis=1)]] = True
    return patches


def subset(elements: Elements, chosen) -> tuple[Elements, np.ndarray]:
    """The elements of the patches `chosen` (p,) bool as a mesh of their own, and the nodes of it, ascending."""
    kept = np.flatnonzero(chosen[elements.patch])
    nodes, cells = compacted(elements.cells[kept])
    law, number = elements.material, np.cumsum(chosen) - 1
    return replace(
        elements,
        cells=cells.astype(np.int32),
        gradients=elements.gradients[kept],
        volumes=elements.volumes[kept],
        patch=number[elements.patch[kept]].astype(np.int32),
        patch_volumes=elements.patch_volumes[chosen],
        patch_lam=elements.patch_lam[chosen],
        material=Material(law.mu[kept], law.lam[kept], law.stiffening[kept], law.extension),
        nodes=len(nodes),
    ), nodes


class Settled(NamedTuple):
    """What became of a displacement (n, 3) mm once its part is in equilibrium, or nearer to it.

    axes (s, 3, 3) of the sliding nodes; energy: its change, mN mm; force (k, 3) mN: its change at the part's nodes;
    least: least J of the part's elements; steps: iterations made.
    """

    displacement: np.ndarray
    axes: np.ndarray
    energy: float
    force: np.ndarray
    least: float
    steps: int


class _State(NamedTuple):
    """A displacement (n, 3) mm of the mesh, the axes (s, 3, 3) of its sliding nodes, and of the part energy, force
    (k, 3) mN and least J."""

    u: np.ndarray
    axes: np.ndarray
    energy: float
    force: np.ndarray
    least: float


class LocalEquilibrium:
    """Some patches of a mesh, whose nodes alone move.

    constrained (n, 3) bool and sliding (s,): as of `boundary.constraints.Constraints`; patches (p,)
    bool: those to bring to equilibrium. inside (n, 3) bool: the unknowns that move; slides: which of the sliding nodes.
    Every patch beside them belongs to the energy: touched (p,) bool; nodes (k,): theirs.
    outer: forces beside those of the elements. barrier: elements stay, or become, the right way out.
    """

    def __init__(self, elements: Elements, constrained, sliding, patches, outer: OuterForces, kind: str, barrier: bool):
        self.patches = patches
        moving = np.zeros(elements.nodes, bool)
        moving[elements.cells[patches[elements.patch]]] = True
        self.inside = ~constrained & moving[:, None]
        self.touched = touching(elements, self.inside.any(axis=1))
        self._elements, self.nodes = subset(elements, self.touched)
        self.slides = np.flatnonzero(self.inside[sliding].any(axis=1))
        self._framed = np.searchsorted(self.nodes, sliding[self.slides])
        self._outer, self._fraction, self._barrier, self._kind = outer.part(self.nodes), 0.0, barrier, kind
        self._assembler = Assembler(self._elements, ~self.inside[self.nodes], self._framed, self._outer.pairs)
        self._linear = linear_solver(self._assembler.indptr, self._assembler.indices, kind, True)
        self._ready = False

    def settled(self, u, held: SlidingNodes, axes, goal: float, fraction: float) -> Settled:
        """The displacement u (n, 3) mm, sliding nodes on their bones with these axes, with the part in equilibrium at a
        fraction of the load.

        goal: norm of the free forces that is enough, mN.
        """
        self._fraction = fraction
        start = state = self._state(u, axes, self._elements)
        made = 0
        if state.least <= 0 and self._barrier:
            loose, self._ready = self._elements.with_extension(UNTANGLING), False
            state, made = self._newton(self._state(u, axes, loose), loose, held, goal, -np.inf)
            self._ready, state = False, self._state(state.u, state.axes, self._elements)
        allowed = 0.0 if state.least > 0 and self._barrier else -np.inf
        state, more = self._newton(state, self._elements, held, goal, allowed)
        change = state.energy - start.energy, state.force - start.force
        return Settled(state.u, state.axes, *change, state.least, made + more)

    def _state(self, u, axes, elements: Elements) -> _State:
        energy, force, least = elements.evaluate(u[self.nodes])
        if self._outer.act:
            loaded, pull = self._outer.evaluate(u[self.nodes], self._fraction)
            energy, force = energy + loaded, force + pull
        return _State(u, axes, energy, force, least)

    def _newton(self, state: _State, elements: Elements, held: SlidingNodes, goal: float, least_allowed: float):
        """The state after some steps, and their number."""
        last, relaxed = np.inf, True
        for step in range(STEPS):
            local = self._local(state.force, state.axes)
            free = self._assembler.gather(local)
            size = np.linalg.norm(free)
            if size <= goal:
                return state, step
            unbalanced = None if relaxed else self._unbalanced(local, QUIET * goal)
            if unbalanced is not None:
                state = self._relaxed(unbalanced, state, elements, held, QUIET * goal, least_allowed)
                last, relaxed = size, True
                continue
            new, kept = None, self._ready and size <= SLOW * last
            for fresh in (False, True) if kept else (True,):
                if fresh and not self._factorize(state, elements, held):
                    return state, step
                new = self._searched(state, elements, held, free, least_allowed)
                if new is not None:
                    break
            if new is None:
                return state, step
            state, last, relaxed = new, size, False
        return state, STEPS

    def _unbalanced(self, local, goal: float) -> np.ndarray | None:
        """Patches (p,) bool about the fewest nodes without which the norm of the forces, local (k, 3) mN, is at the
        goal, mN; None where these are not few."""
        square = (np.where(self._assembler.free, local, 0) ** 2).sum(axis=1)
        order = np.argsort(-square, kind="stable")
        rest = np.cumsum(square[order][::-1])[::-1]  # of a node and all that are quieter
        count = int(np.count_nonzero(rest > goal**2))
        if count > FEW * np.count_nonzero(square):
            return None
        patches = touching(self._elements, order[:count])
        return patches if patches.mean() < SMALL else None

    def _relaxed(self, patches, state: _State, elements, held, goal: float, least_allowed: float) -> _State:
        """The state with these patches (p,) bool in equilibrium, or nearer to it, while the rest stays."""
        fixed = ~self._assembler.free
        part = LocalEquilibrium(elements, fixed, self._framed, patches, self._outer, self._kind, self._barrier)
        part._fraction, slides = self._fraction, part.slides
        start = part._state(state.u[self.nodes], state.axes[slides], part._elements)
        surfaces = held.part(slides, self._framed[slides])
        done, _ = part._newton(start, part._elements, surfaces, goal, least_allowed)
        part.close()
        u, axes = state.u.copy(), state.axes.copy()
        u[self.nodes], axes[slides] = done.u, done.axes
        return self._state(u, axes, elements)

    def _searched(self, state: _State, elements, held, free, least_allowed: float) -> _State | None:
        """The state after a step of the factors along which the energy falls, None if there is none."""
        motion = self._assembler.scatter(-self._linear.solve(free))
        slides = len(self._framed) > 0
        if slides:
            motion[self._framed] = np.einsum("sij,si->sj", state.axes, motion[self._framed])
        slope = -float(np.vdot(motion, state.force))
        slide = np.linalg.norm(motion[self._framed], axis=1).max(initial=0.0)
        share = min(1.0, SLIDE * elements.edge / max(slide, 1e-30))
        noise = elements.noise(state.energy)
        while share > 1e-4:
            u = state.u.copy()
            u[self.nodes] += share * motion
            new = self._state(u, held.project(u) if slides else state.axes, elements)
            if new.least > least_allowed and new.energy <= state.energy - 1e-4 * share * slope + noise:
                return new
            share /= 2
        return None

    def _factorize(self, state: _State, elements, held) -> bool:
        """Factors of the present tangent, of the one without negative eigenvalues if need be."""
        slides = len(self._framed) > 0
        frames = state.axes if slides else np.zeros((0, 3, 3))
        for definite in (0.0, 1.0):
            data, _ = self._assembler.tangent(state.u[self.nodes], frames, definite=definite, elements=elements)
            if slides and not definite:
                curvature = held.curvature(state.u, state.axes, state.force[self._framed])
                self._assembler.add(data, np.repeat(self._framed[:, None], 2, axis=1), curvature)
            if len(self._outer.pairs):
                tense = turned(self._outer.blocks, self._outer.pairs, len(self.nodes), self._framed, frames)
                self._assembler.add(data, self._outer.pairs, tense)
            self._ready = self._linear.factorize(data)
            if self._ready:
                return True
        return False

    def _local(self, vectors, axes) -> np.ndarray:
        turned = np.array(vectors)
        if len(self._framed):
            turned[self._framed] = np.einsum("sij,sj->si", axes, turned[self._framed])
        return turned

    def close(self) -> None:
        """Release the factors."""
        self._linear.close()
