"""Many plans of one patient, whole batches at once: the kept factors on a GPU.

L-BFGS on the kept factor of the stiffness at rest, warped; hard patches and those that touch sliding nodes in
equilibrium before every step is judged. As many plans as there are slots advance together, and where one ends the next
begins. Field, energy and force are in double precision, directions, pairs and factors in single. What fails or strays
goes on in increments of the load, and then to the solver of one plan. The same calls give the same bits.
"""

import logging
import time
from collections import deque
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import torch
from scipy import sparse
from torch import Tensor

from pinnochio.mechanics.boundary.conditions import BoundaryConditions
from pinnochio.mechanics.boundary.constraints import Constraints
from pinnochio.mechanics.boundary.sliding import SlidingNodes, SlidingSurfaces, bones_of
from pinnochio.mechanics.elements.assembly import Assembler
from pinnochio.mechanics.elements.materials import Material
from pinnochio.mechanics.elements.tetrahedra import RELATIVE_ROUND_OFF, Elements, least_reaction
from pinnochio.mechanics.settings import SolverSettings
from pinnochio.mechanics.solvers import kept_factors
from pinnochio.mechanics.solvers.batched import batch_sliding
from pinnochio.mechanics.solvers.batched.batch_energy import BatchElements
from pinnochio.mechanics.solvers.batched.batch_sliding import BatchSliding
from pinnochio.mechanics.solvers.batched.cuda_graphs import ReplayedCalls
from pinnochio.mechanics.solvers.batched.fronts import Fronts
from pinnochio.mechanics.solvers.batched.hard_patches import HardPatches
from pinnochio.mechanics.solvers.batched.sparse_rows import SparseRows, fused
from pinnochio.mechanics.solvers.kept_factors import KeptFactors, beside, kept_result, mean_gradients
from pinnochio.mechanics.solvers.local_equilibrium import touching
from pinnochio.mechanics.solvers.newton import SolveResult

LOG = logging.getLogger(__name__)

SLOTS = 256  # plans that advance together [X]
MEMORY = 5  # pairs of steps and changes of the force that are kept
SETTLED = 0.1  # force left in the hard patches, over the whole, before a step; 0.3 of it is aimed at [X]
HALVINGS = 12  # of a step at most
RUNNING, SOLVED, FAILED, IDLE = range(4)
# What is known of a plan: the first ones make its history, the last one is whether its hard patches became more.
NAMES = "code", "residual", "energy", "min_jacobian", "iterations", "step"
CODE, RESIDUAL, ENERGY, LEAST, ITERATIONS, STEP, SLOPE, GOAL, TOLERANCE, HALVED, FRESH, AGAIN = range(12)


class PrescribedMotion(NamedTuple):
    """What one plan asks for: the displacement (n, 3) mm of its constrained nodes, sliding ones carried by their bones,
    zero elsewhere; and the sliding sets in its motion."""

    motion: np.ndarray
    sliding: SlidingSurfaces


class BatchSolver:
    """The factors of one mesh with one set of constrained nodes, on a device, for any number of motions.

    points (n, 3) mm, cells (m, 4). The first boundary tells the nodes and the bones that they slide on; what bears or
    is loaded is solved as by :class:`KeptFactors`. slots: plans at once.
    """

    def __init__(
        self,
        points,
        cells,
        material: Material,
        boundary: BoundaryConditions,
        settings: SolverSettings,
        device: str,
        slots: int = SLOTS,
    ):
        self._problem = points, cells, material, boundary, settings
        self._settings, self._device, self._slots = settings, torch.device(device), slots
        self._alone: KeptFactors | None = None
        whole = Elements.build(points, cells, material, settings.volumetric)
        self._constraints = Constraints(points, whole.cells, boundary)
        used = np.zeros(whole.nodes, bool)
        used[whole.cells] = True
        held = self._constraints.constrained.all(axis=1)
        parts = used & ~held, used & held, ~used
        order = np.concatenate([np.flatnonzero(part) for part in parts])
        self._free, count = int(parts[0].sum()), int(used.sum())
        self._elements = elements = _renumbered(whole, order)
        self._fixed = slice(self._free, count)
        place, sliding = np.argsort(order), self._constraints.sliding
        self._place, self._order = (torch.as_tensor(item, device=self._device) for item in (place, order))
        frames, slipping = sliding.frames(np.zeros((whole.nodes, 3)), 0.0), place[sliding.nodes]
        self._bones, constrained = bones_of(sliding, frames), self._constraints.constrained[order]
        inner, coupling = _parts(_stiffness(elements, slipping, frames), constrained, self._free)
        self._fronts = Fronts(np.asarray(points, float)[order[: self._free]], inner, self._device)
        self._coupling = SparseRows(coupling, self._device, torch.float32)
        self._constrained = torch.as_tensor(constrained, device=self._device)[:, :, None]
        self._frames = torch.as_tensor(frames, device=self._device)[..., None]
        self._sliding = torch.as_tensor(slipping, device=self._device)
        self._mesh = BatchElements(elements, self._device)
        self._gradients = SparseRows(mean_gradients(elements)[: 3 * self._free], self._device, torch.float32)
        self._beside = SparseRows(beside(elements), self._device, torch.float64)
        self._work: _Slots | None = None

    def solve(self, boundaries: Sequence[BoundaryConditions]) -> list[SolveResult]:
        """The solution of each boundary condition, which differs from the first one in its motion alone."""
        began = time.perf_counter()
        quick = [not (item.contact or item.loads) and self._settings.barrier for item in boundaries]
        numbers = np.flatnonzero(quick)
        prescribed, fields, progress_of = [], [], []
        if len(numbers):
            try:
                prescribed = [self.prescribed(boundaries[number]) for number in numbers]
                fields, progress_of = self.fields(prescribed)
            except (torch.OutOfMemoryError, batch_sliding.TooManyPointsError) as error:
                LOG.warning("the plans are left to the CPU: %s", error)
        share = (time.perf_counter() - began) / max(len(numbers), 1)
        results: list[SolveResult | None] = [None] * len(boundaries)
        for number, plan, field, progress in zip(numbers, prescribed, fields, progress_of, strict=False):
            if progress.solved:
                violation = SlidingNodes(self._bones, plan.sliding).violation(field)
                results[number] = _result(field, progress, share, violation)
        left = [number for number, result in enumerate(results) if result is None]
        if left:
            if self._alone is None:
                self._alone = KeptFactors(*self._problem)
            alone = self._alone.solve([boundaries[number] for number in left])
            for number, result in zip(left, alone, strict=True):
                results[number] = replace(result, seconds=result.seconds + (share if quick[number] else 0))
        return results

    def close(self) -> None:
        """Release the factors."""
        if self._alone is not None:
            self._alone.close()

    def prescribed(self, boundary: BoundaryConditions) -> PrescribedMotion:
        """What a boundary condition asks for."""
        plan = self._constraints.under(boundary)
        return PrescribedMotion(plan.motions(), plan.sliding)

    def fields(self, prescribed: Sequence[PrescribedMotion]) -> tuple[np.ndarray, list["PlanProgress"]]:
        """Fields (k, n, 3) mm of some plans, and how each was solved, if it was."""
        slots = min(self._slots, 1 << (len(prescribed) - 1).bit_length())
        if self._work is None or self._work.plans != slots:
            self._work = _Slots(self, slots)
        motions = torch.as_tensor(np.array([plan.motion for plan in prescribed]), device=self._device)
        fields, progress_of = self._work.run(motions[:, self._order], [plan.sliding for plan in prescribed])
        fields, on_gpu = fields[:, self._place], self._device.type == "cuda"
        return torch.empty(fields.shape, dtype=fields.dtype, pin_memory=on_gpu).copy_(fields).numpy(), progress_of

    def linear(self, motions: Tensor) -> Tensor:
        """Fields (n, 3, k) mm in equilibrium at rest with motions (n, 3, k) mm of the constrained nodes, about; here
        and below with the free nodes first."""
        fields, nodes = motions.clone(), self._sliding
        fields[nodes] = batch_sliding.inward(self._frames, fields[nodes])
        fields = torch.where(self._constrained, fields, 0)
        load = -self._coupling(fields.float().reshape(-1, motions.shape[2]))
        fields[: self._free] += self._fronts.solve(load.view(-1, 3, motions.shape[2]))
        fields[nodes] = batch_sliding.outward(self._frames, fields[nodes])
        return fields


class _Slots:
    """The plans that advance together, and what is known of each of them."""

    def __init__(self, solver: BatchSolver, plans: int):
        self._solver, self.plans = solver, plans
        self._settings, elements, device = solver._settings, solver._elements, solver._device
        nodes, free = elements.nodes, solver._free

        def zeros(*shape, dtype=torch.float64):
            return torch.zeros(*shape, plans, dtype=dtype, device=device)

        self._law = zeros() + elements.material.extension
        fixed = int(solver._constraints.constrained.sum())
        self._floor, self._noise = zeros() + least_reaction(elements, fixed), zeros() + elements.round_off
        self._u, self._trial, self._start = zeros(nodes, 3), zeros(nodes, 3), zeros(nodes, 3)
        sliding_kind, patches_kind = (BatchSliding, HardPatches) if device.type == "cpu" else _on_gpu()
        slipping = solver._sliding.cpu().numpy()
        self._bones = solver._bones._replace(nodes=slipping)
        self._slides = sliding_kind(self._bones, plans, device)
        # Of the sliding nodes: axes where the plans are (the slides have those of the trials), normals at their starts.
        self._axes, self._normals = zeros(len(slipping), 3, 3), zeros(len(slipping), 3)
        self._across = zeros(nodes, 3)  # normals of the trials, zero at other nodes
        self._gradient, self._direction = zeros(free, 3), zeros(free, 3, dtype=torch.float32)
        self._now = zeros(AGAIN + 1)
        self._now[CODE] = IDLE
        self._running, self._lowest = zeros(dtype=torch.bool), zeros()
        # Pairs in a ring; the last place takes what is not kept.
        self._steps, self._changes = (zeros(MEMORY + 1, free, 3, dtype=torch.float32) for _ in range(2))
        self._products, self._ring = zeros(MEMORY + 1, MEMORY + 1), zeros(2, dtype=torch.long)
        self._known = zeros(len(elements.patch_volumes), dtype=torch.bool)
        self._hard_patches = patches_kind(elements, np.arange(nodes) < free, plans, device)
        self._shell = torch.as_tensor(touching(elements, slipping), device=device)[:, None]
        self._ready = False
        self._prepare = ReplayedCalls(lambda: self._hard_patches.prepare(self._known), device)
        self._place, self._judge = ReplayedCalls(self._placed, device), ReplayedCalls(self._judged, device)

    def run(self, motions: Tensor, sliding: Sequence[SlidingSurfaces]) -> tuple[Tensor, list["PlanProgress"]]:
        """As :meth:`BatchSolver.fields`."""
        fields, linear = torch.empty_like(motions), torch.empty_like(motions)
        for at in range(0, len(motions), self.plans):
            part = motions[at : at + self.plans].permute(1, 2, 0).contiguous()
            linear[at : at + self.plans] = self._solver.linear(part).permute(2, 0, 1)
        progress_of = [PlanProgress(sets) for sets in sliding]
        owner, waiting = np.full(self.plans, -1), deque(range(len(motions)))
        self._fill(owner, np.arange(self.plans), waiting, progress_of, linear)
        while (owner >= 0).any():
            if not self._ready:
                self._prepare()
            self._place()
            self._hard_patches.settle(self._trial, self._across, self._now[GOAL], self._lowest, self._running)
            self._judge()
            status = np.array(self._now.cpu())
            codes, self._ready = status[CODE].astype(int), not status[AGAIN].any()
            for slot in np.flatnonzero((owner >= 0) & ((status[FRESH] == 0) | (codes != RUNNING))):
                progress_of[owner[slot]].note(status[: len(NAMES), slot])
            ended = np.flatnonzero((owner >= 0) & (codes != RUNNING))
            if len(ended):
                strayed = self._strayed()
                at = torch.as_tensor(ended, device=fields.device)
                fields[torch.as_tensor(owner[ended], device=fields.device)] = self._u[:, :, at].permute(2, 0, 1)
                for slot in ended[::-1]:
                    plan = owner[slot]
                    if progress_of[plan].goes_on(strayed[slot], fields[plan]):
                        waiting.appendleft(plan)
                self._fill(owner, ended, waiting, progress_of, linear)
        return fields, progress_of

    def _fill(self, owner, slots, waiting: deque, progress_of: list["PlanProgress"], linear: Tensor) -> None:
        """Give the next plans, or parts of a load, to slots (s,) whose own have ended."""
        owner[slots] = -1
        self._now[CODE, torch.as_tensor(slots, device=linear.device)] = IDLE
        slots = slots[: len(waiting)]
        if not len(slots):
            return
        owner[slots] = plans = [waiting.popleft() for _ in slots]
        going = [progress_of[plan] for plan in plans]
        shares, now = [progress.fraction - progress.done for progress in going], np.zeros((len(self._now), len(slots)))
        now[FRESH] = 1
        tolerances = self._settings.loose, self._settings.tolerance
        now[TOLERANCE] = [tolerances[progress.fraction == 1] for progress in going]
        at, chosen, shares = (torch.as_tensor(item, device=linear.device) for item in (slots, plans, shares))
        begin = shares[:, None, None] * linear[chosen]
        for place, progress in enumerate(going):
            if progress.field is not None:
                begin[place] += progress.field
        self._slides.begin(slots, [SlidingNodes(self._bones, plan.sliding, plan.fraction) for plan in going])
        self._now[:, at] = torch.as_tensor(now, device=linear.device)
        self._u[:, :, at] = begin.permute(1, 2, 0)
        new = torch.zeros_like(self._running)
        new[at] = True
        self._slides.project(self._u, new)
        self._start[:, :, at] = self._u[:, :, at]
        self._normals[:, :, at] = self._slides.axes[:, 0][:, :, at]
        self._direction[:, :, at] = 0
        self._ring[:, at] = 0
        self._known[:, at], self._ready = self._shell, False

    def _placed(self) -> None:
        """One step of every plan whose last one was judged."""
        _go(self._trial, self._u, self._direction, self._now, self._hard_patches.open, self._running, self._lowest)
        self._slides.project(self._trial, ~self._hard_patches.open)
        self._across[self._solver._sliding] = self._slides.axes[:, 0]

    def _judged(self) -> None:
        """Take the trial where it is good, else halve the step; find the next direction."""
        solver, now, free, nodes = self._solver, self._now, self._solver._free, self._solver._sliding
        running = self._running & ~self._hard_patches.open
        self._slides.project(self._trial, running)
        state = solver._mesh.measure(self._trial, self._law)
        force, least = state.force[:free], state.ratio.amin(0)
        wild = least < self._lowest
        hard = solver._mesh.of_patches(_hard(state.ratio, state.stretch))
        new = _unknown(hard, self._known, running & ~wild)
        self._known |= self._hard_patches.wide(new)
        again = new.any(0)
        reaction = torch.linalg.vector_norm(state.force[solver._fixed], dim=(0, 1))
        reaction = torch.hypot(reaction, torch.linalg.vector_norm(self._slides.turn(force), dim=0))
        size, reaction = torch.linalg.vector_norm(force, dim=(0, 1)), torch.maximum(reaction, self._floor)
        good = _weighed(now, running, again, wild, state.energy, least, size, reaction, self._noise)
        self._remember(good, force)
        _take(good, self._u, self._trial, self._gradient, force)
        self._axes.copy_(torch.where(good, self._slides.axes, self._axes))
        q, shares = self._next()
        before = self._direction[nodes]
        slope = _turn(good, self._direction, q, self._steps, shares, self._gradient)
        turned = batch_sliding.outward(self._axes, self._direction[nodes].double()).float()
        self._direction[nodes] = torch.where(good, turned, before)
        _ended(now, running, good, slope, self._settings.loose)

    def _remember(self, good: Tensor, force: Tensor) -> None:
        """Keep the step to the trial and the change of the force in place of the oldest pair."""
        step, change = _differences(self._trial, self._u, force, self._gradient)
        self._slides.turn(step)
        place = _kept_place(self._ring, good, self._now[ITERATIONS], *_products(step, change))
        for pairs, new in ((self._steps, step), (self._changes, change)):
            pairs.scatter_(0, place.expand(1, *new.shape), new[None])
        _put(self._products, place, _against(self._changes, step), _against(self._steps, change))

    def _next(self) -> tuple[Tensor, Tensor]:
        """Minus the direction but for the steps that it goes along, and their shares (MEMORY + 1, k) by place."""
        solver, gradient = self._solver, self._gradient.float()
        shares = _back(self._products, self._ring, _against(self._steps, gradient))
        warp = _kept_volume(solver._gradients(self._u.float()).view(-1, 3, 3, self.plans))
        nodes = solver._sliding
        warp[nodes] = batch_sliding.carried(self._axes, warp[nodes], solver._frames)
        q = _warped(warp, solver._fronts.solve(_unwarped(warp, gradient, self._changes, shares)))
        return q, _forth(self._products, self._ring, _against(self._changes, q), shares)

    def _strayed(self) -> np.ndarray:
        """Plans (k,) bool that may have found another equilibrium, as by
        :meth:`pinnochio.mechanics.solvers.kept_factors.KeptFactors`."""
        moved, nodes = self._u - self._start, self._solver._sliding
        far = torch.linalg.vector_norm(moved - self._solver._beside(moved), dim=1).amax(0)
        strayed = far > kept_factors.STRAY * self._solver._elements.edge
        strayed |= ((self._normals * self._axes[:, 0]).sum(1) < kept_factors.RIM).any(0)
        strayed |= (torch.linalg.vector_norm(moved[nodes], dim=1) > kept_factors.SLIDE).any(0)
        return strayed.cpu().numpy()


def _on_gpu():
    from pinnochio.mechanics.solvers.batched.batch_sliding_gpu import GpuSliding  # only where Triton is
    from pinnochio.mechanics.solvers.batched.hard_patches_gpu import GpuHardPatches

    return GpuSliding, GpuHardPatches


class PlanProgress:
    """How far one plan has come: it begins with the whole load, and what fails goes on in increments, as in
    :mod:`pinnochio.mechanics.solvers.kept_factors`. sliding: its sliding sets; iterations: in all."""

    def __init__(self, sliding: SlidingSurfaces):
        self.sliding, self.share, self.field, self.iterations = sliding, 1.0, None, 0
        self.done, self._steps = 0.0, []

    @property
    def fraction(self) -> float:
        """Of the load, which it is at."""
        return min(self.done + self.share, 1.0)

    @property
    def solved(self) -> bool:
        """Whether the whole load is reached."""
        return self.done == 1

    @property
    def history(self) -> list[dict]:
        """What each step came to: the numbers of NAMES, and the fraction of the load."""
        return [dict(zip(NAMES, status.tolist(), strict=True), fraction=fraction) for fraction, status in self._steps]

    def note(self, status: np.ndarray) -> None:
        """Keep what a step came to, the numbers of NAMES."""
        self._steps.append((self.fraction, status))

    def goes_on(self, strayed: bool, field: Tensor) -> bool:
        """Whether a part of the load is left to do after one that ended with a field (n, 3) mm.

        Increments that strayed do not count but the least ones, which lead where they lead.
        """
        last = self._steps[-1][1]
        self.iterations += int(last[ITERATIONS])
        if last[CODE] == SOLVED and not (strayed and self.share > kept_factors.LEAST_INCREMENT):
            self.done = self.fraction
            self.field = None if self.solved else field.clone()
            return not self.solved
        self.share = min(self.share / 2, kept_factors.INCREMENT)
        return self.share >= kept_factors.LEAST_INCREMENT


def _result(field, progress: PlanProgress, seconds: float, violation: float) -> SolveResult:
    names = "fraction", "residual", "energy", "min_jacobian", "step"
    history = [{name: entry[name] for name in names} for entry in progress.history]
    least, residual = history[-1]["min_jacobian"], history[-1]["residual"]
    return kept_result(field, history, least, residual, progress.iterations, seconds, violation)


def _renumbered(elements: Elements, nodes) -> Elements:
    """The elements with nodes (n,) in this order, themselves in the order of their patches, so that neighbouring lanes
    read neighbouring ones."""
    order, law = np.argsort(elements.patch, kind="stable"), elements.material
    return replace(
        elements,
        cells=np.argsort(nodes)[elements.cells[order]].astype(np.int32),
        gradients=elements.gradients[order],
        volumes=elements.volumes[order],
        patch=elements.patch[order],
        material=replace(law, mu=law.mu[order], lam=law.lam[order], stiffening=law.stiffening[order]),
    )


def _stiffness(elements: Elements, framed, frames) -> sparse.csr_array:
    """The tangent at rest (3n, 3n), of nodes (s,) in their own axes (s, 3, 3); zero at nodes without elements."""
    rest = np.zeros((elements.nodes, 3))
    whole = Assembler(elements, np.zeros(rest.shape, bool), framed)
    full = whole.symmetric(whole.tangent(rest, frames)[0]).tocoo()
    place = np.flatnonzero(whole.free)
    return sparse.csr_array((full.data, (place[full.row], place[full.col])), (rest.size, rest.size))


def _parts(stiffness: sparse.csr_array, constrained, free: int) -> tuple[sparse.bsr_array, sparse.csr_array]:
    """Of the first nodes, `free` of them: the stiffness (3 free, 3 free) between what is not constrained, (n, 3) bool,
    with its diagonal alone where that is constrained; and what couples it to all that is constrained (3 free, 3n)."""
    rows, fixed = stiffness[: 3 * free], constrained.ravel().astype(float)
    left = sparse.diags_array(1 - fixed[: 3 * free])
    inner = left @ rows[:, : 3 * free] @ left + sparse.diags_array(rows.diagonal() * fixed[: 3 * free])
    coupling = sparse.csr_array(left @ rows @ sparse.diags_array(fixed))
    coupling.eliminate_zeros()
    return sparse.bsr_array(inner, blocksize=(3, 3)), coupling


@fused
def _go(trial, u, direction, now, waits, running, lowest):
    free = len(direction)
    trial[:free] = torch.where(waits, trial[:free], u[:free] + now[STEP] * direction)
    trial[free:] = u[free:]
    running.copy_(now[CODE] == RUNNING)
    lowest.copy_(torch.where(now[FRESH] > 0, -torch.inf, float(kept_factors.WILD)))


@fused
def _hard(ratio, stretch):
    return ((ratio < kept_factors.HARD_RATIO) | (stretch > kept_factors.HARD_STRETCH)).float()


@fused
def _unknown(hard, known, running):
    return (hard > 0) & ~known & running


@fused
def _weighed(now, running, again, wild, energy, least, size, reaction, noise):
    """Which plans' trials are good, and in now what follows but for the direction."""
    fresh = now[FRESH] > 0
    falls = energy <= now[ENERGY] + 1e-4 * now[STEP] * now[SLOPE] + noise + RELATIVE_ROUND_OFF * now[ENERGY].abs()
    falls = falls & ~wild & (least > torch.where(now[LEAST] > 0, 0.0, -torch.inf))
    judged = running & ~again
    good = judged & torch.isfinite(energy) & (falls | fresh)
    bad = judged & ~good
    goal = 0.3 * torch.maximum(SETTLED * size, 0.3 * now[TOLERANCE] * reaction)
    rows = (
        now[CODE],
        torch.where(good, size / reaction, now[RESIDUAL]),
        torch.where(good, energy, now[ENERGY]),
        torch.where(good, least, now[LEAST]),
        now[ITERATIONS] + (good & ~fresh),
        torch.where(good, 1.0, torch.where(bad, now[STEP] / 2, now[STEP])),
        now[SLOPE],
        torch.where(good, goal, torch.where(running & again & fresh, 0.02 * size, now[GOAL])),
        now[TOLERANCE],
        torch.where(good, 0.0, now[HALVED] + bad),
        torch.where(good, 0.0, now[FRESH]),
        again.double(),
    )
    now.copy_(torch.stack(rows))
    return good


@fused
def _ended(now, running, good, slope, loose):
    """Which plans are solved or have failed, in now."""
    residual, least, iterations = now[RESIDUAL], now[LEAST], now[ITERATIONS]
    solved = good & (residual <= now[TOLERANCE]) & (least > 0)
    failed = (now[HALVED] > HALVINGS) | (iterations >= kept_factors.ITERATIONS)
    failed = failed | (good & (residual <= loose) & ~(least > 0)) | (good & ~solved & ~(slope < 0))
    failed = failed | (good & (iterations == kept_factors.PATIENCE) & (residual > kept_factors.FAR))
    code = torch.where(running & solved, float(SOLVED), torch.where(running & failed, float(FAILED), now[CODE]))
    slope = torch.where(good, slope, now[SLOPE])
    now.copy_(torch.cat([code[None], now[1:SLOPE], slope[None], now[SLOPE + 1 :]]))


@fused
def _take(good, u, trial, gradient, force):
    u.copy_(torch.where(good, trial, u))
    gradient.copy_(torch.where(good, force, gradient))


@fused
def _differences(trial, u, force, gradient):
    return (trial[: len(force)] - u[: len(force)]).float(), (force - gradient).float()


@fused
def _products(step, change):
    step, change = step.double(), change.double()
    return (step * change).sum((0, 1)), (step * step).sum((0, 1)), (change * change).sum((0, 1))


@fused
def _kept_place(ring, good, iterations, both, one, two):
    """Place (k,) of a new pair, and in ring (2, k) that of the newest one and how many there are."""
    kept = good & (iterations > 0) & (both > 1e-12 * torch.sqrt(one * two))
    place = torch.where(kept, (ring[0] + 1) % MEMORY, MEMORY)
    ring.copy_(torch.stack([torch.where(kept, place, ring[0]), torch.clamp(ring[1] + kept, max=MEMORY)]))
    return place


@fused
def _put(products, place, by_step, by_change):
    """The products (i, j, k) of step i with change j, with those of the new pair."""
    here = torch.arange(MEMORY + 1, device=place.device)[:, None] == place
    products.copy_(torch.where(here[:, None], by_step, torch.where(here[None], by_change[:, None], products)))


@fused
def _against(pairs, x):
    return (pairs * x).sum((1, 2)).double()


def _by_age(products, ring, against):
    """Places (MEMORY, k) of the pairs, newest first, which of them there are, and products and against so."""
    rank = torch.arange(MEMORY, device=ring.device)[:, None]
    order = (ring[0] - rank) % MEMORY
    both = (order[:, None] * (MEMORY + 1) + order[None]).flatten(0, 1)
    products = products.flatten(0, 1).gather(0, both).unflatten(0, (MEMORY, MEMORY))
    there = rank < ring[1]
    squares = torch.where(there, products.diagonal().T, 1.0)
    return order, there, products, squares, against.gather(0, order)


@fused
def _back(products, ring, against):
    """Shares (MEMORY + 1, k), by place, of the changes that the first loop of L-BFGS takes off the gradient."""
    order, there, products, squares, against = _by_age(products, ring, against)
    shares = []
    for i in range(MEMORY):
        value = against[i] - sum((shares[j] * products[i, j] for j in range(i)), torch.zeros_like(squares[0]))
        shares.append(torch.where(there[i], value / squares[i], 0.0))
    return torch.zeros_like(products[0, 0].expand(MEMORY + 1, -1)).scatter(0, order, torch.stack(shares))


@fused
def _forth(products, ring, against, shares):
    """Shares, by place, of the steps that the second loop goes along."""
    order, there, products, squares, against = _by_age(products, ring, against)
    shares, taken = shares.gather(0, order), {}
    for i in reversed(range(MEMORY)):
        later = range(i + 1, MEMORY)
        value = against[i] + sum((taken[j] * products[j, i] for j in later), torch.zeros_like(squares[0]))
        taken[i] = torch.where(there[i], shares[i] - value / squares[i], 0.0)
    taken = torch.stack([taken[i] for i in range(MEMORY)])
    return torch.zeros_like(products[0, 0].expand(MEMORY + 1, -1)).scatter(0, order, taken)


def _combined(pairs, shares):
    return (pairs[:MEMORY] * shares[:MEMORY].float()[:, None, None]).sum(0)


@fused
def _turn(good, direction, q, steps, shares, gradient):
    """The new directions where trials are good; their slopes (k,)."""
    direction.copy_(torch.where(good, -(q + _combined(steps, shares)), direction))
    return (direction * gradient).sum((0, 1))


@fused
def _kept_volume(mean):
    """Displacement gradients, transposed, to deformation gradients of determinant 1, or unity."""
    g = [[mean[:, j, i] + (1 if i == j else 0) for j in range(3)] for i in range(3)]
    det = sum(
        g[0][i] * (g[1][(i + 1) % 3] * g[2][(i + 2) % 3] - g[1][(i + 2) % 3] * g[2][(i + 1) % 3]) for i in range(3)
    )
    size = sum(g[i][j] * g[i][j] for i in range(3) for j in range(3))
    good = det > 1e-3 * size**1.5
    scale = torch.where(good, det, 1.0) ** (-1 / 3)
    one, zero = torch.ones_like(det), torch.zeros_like(det)
    flat = [torch.where(good, g[i][j] * scale, one if i == j else zero) for i in range(3) for j in range(3)]
    return torch.stack(flat, 1).unflatten(1, (3, 3))


@fused
def _unwarped(warp, gradient, changes, shares):
    return (warp * (gradient - _combined(changes, shares))[:, :, None]).sum(1)


@fused
def _warped(warp, q):
    return (warp * q[:, None]).sum(2)
