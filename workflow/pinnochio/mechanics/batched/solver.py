"""Many plans of one patient, whole batches at once: the way of :mod:`pinnochio.mechanics.repeated` on a GPU.

Bonded plans: L-BFGS on the kept factor of the stiffness at rest, warped; hard patches in equilibrium before every step
is judged. As many plans as there are slots advance together, and where one ends the next begins. Field, energy and
force are in double precision, directions, pairs and factors in single.
What fails goes to the solver of one plan. The same calls give the same bits.
"""

import logging
import time
from collections import deque
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import torch
from scipy import sparse
from torch import Tensor

from pinnochio.mechanics import repeated
from pinnochio.mechanics.assembly import Assembler
from pinnochio.mechanics.batched import zone
from pinnochio.mechanics.batched.fronts import Fronts
from pinnochio.mechanics.batched.law import Mesh
from pinnochio.mechanics.batched.recorded import Recorded
from pinnochio.mechanics.batched.rows import Rows, fused
from pinnochio.mechanics.constraints import Constraints
from pinnochio.mechanics.elements import Elements
from pinnochio.mechanics.materials import Material
from pinnochio.mechanics.repeated import RepeatedSolver, beside, mean_gradients
from pinnochio.mechanics.sliding import BoundaryConditions
from pinnochio.mechanics.solver import SolveResult, SolverOptions

LOG = logging.getLogger(__name__)

SLOTS = 256  # plans that advance together [X]
MEMORY = 5  # pairs of steps and changes of the force that are kept
SETTLED = 0.1  # force left in the hard patches, over the whole, before a step; 0.3 of it is aimed at [X]
HALVINGS = 12  # of a step at most
RUNNING, SOLVED, FAILED, IDLE = range(4)


class BatchSolver:
    """The factors of one mesh with one set of prescribed nodes, on a device, for any number of motions.

    points (n, 3) mm, cells (m, 4). The first boundary tells the nodes; what slides, bears or is loaded is solved as by
    :class:`RepeatedSolver`. slots: plans at once.
    """

    def __init__(
        self,
        points,
        cells,
        material: Material,
        boundary: BoundaryConditions,
        options: SolverOptions,
        device: str,
        slots: int = SLOTS,
    ):
        self._asked = points, cells, material, boundary, options
        self._options, self._device, self._slots = options, torch.device(device), slots
        self._alone: RepeatedSolver | None = None
        self._elements = elements = _by_patch(Elements.build(points, cells, material, options.volumetric))
        self._constraints = Constraints(points, elements.cells, boundary)
        used = np.zeros(elements.nodes, bool)
        used[elements.cells] = True
        held = self._constraints.constrained.all(axis=1)
        self._free, fixed = used & ~held, np.flatnonzero(used & held)
        free = np.flatnonzero(self._free)
        stiffness = _stiffness(elements)
        inner = sparse.bsr_array(_part(stiffness, free, free), blocksize=(3, 3))
        self._fronts = Fronts(np.asarray(points, float)[free], inner, self._device)
        self._coupling = Rows(_part(stiffness, free, fixed), self._device, torch.float32)
        self._nodes, self._fixed = (torch.as_tensor(item, device=self._device) for item in (free, fixed))
        self._mesh = Mesh(elements, self._device)
        rows = (3 * free[:, None] + np.arange(3)).ravel()
        self._gradients = Rows(mean_gradients(elements)[rows], self._device, torch.float32)
        self._beside = Rows(beside(elements), self._device, torch.float64)
        self._work: _Slots | None = None

    def solve(self, boundaries: Sequence[BoundaryConditions]) -> list[SolveResult]:
        """The solution of each boundary condition, which differs from the first one in its motion alone."""
        began = time.perf_counter()
        quick = [not (item.contact or item.loads or item.sliding) and self._options.barrier for item in boundaries]
        numbers = np.flatnonzero(quick)
        fields, records = [], []
        if len(numbers):
            try:
                fields, records = self.fields(np.array([self.motions(boundaries[number]) for number in numbers]))
            except torch.OutOfMemoryError as error:
                LOG.warning("the plans are left to the CPU: %s", error)
        share = (time.perf_counter() - began) / max(len(numbers), 1)
        results: list[SolveResult | None] = [None] * len(boundaries)
        for number, field, record in zip(numbers, fields, records, strict=False):
            if record[-1]["code"] == SOLVED:
                results[number] = _result(field, record, share)
        left = [number for number, result in enumerate(results) if result is None]
        if left:
            if self._alone is None:
                self._alone = RepeatedSolver(*self._asked)
            alone = self._alone.solve([boundaries[number] for number in left])
            for number, result in zip(left, alone, strict=True):
                results[number] = replace(result, seconds=result.seconds + (share if quick[number] else 0))
        return results

    def close(self) -> None:
        """Release the factors."""
        if self._alone is not None:
            self._alone.close()

    def motions(self, boundary: BoundaryConditions) -> np.ndarray:
        """Displacement (n, 3) mm that a boundary condition prescribes, zero elsewhere."""
        return self._constraints.under(boundary).motions()

    def fields(self, motions: np.ndarray) -> tuple[np.ndarray, list[list[dict]]]:
        """Fields (k, n, 3) mm of prescribed motions (k, n, 3) mm, and the record of each plan, whose last entry's code
        says whether it is SOLVED or FAILED."""
        slots = min(self._slots, 1 << (len(motions) - 1).bit_length())
        if self._work is None or self._work.plans != slots:
            self._work = _Slots(self, slots)
        return self._work.run(torch.as_tensor(motions, device=self._device))

    def linear(self, motions: Tensor) -> Tensor:
        """Fields (n, 3, k) mm in equilibrium at rest with motions (n, 3, k) mm of the prescribed nodes, about."""
        load = -self._coupling(motions[self._fixed].float().reshape(-1, motions.shape[2]))
        fields = motions.clone()
        fields[self._nodes] = self._fronts.solve(load.view(-1, 3, motions.shape[2])).double()
        return fields


class _Slots:
    """The plans that advance together, and what is known of each of them."""

    def __init__(self, solver: BatchSolver, plans: int):
        self._solver, self.plans = solver, plans
        self._options, elements, device = solver._options, solver._elements, solver._device
        nodes, free = elements.nodes, len(solver._nodes)

        def zeros(*shape, dtype=torch.float64):
            return torch.zeros(*shape, plans, dtype=dtype, device=device)

        self._law = zeros() + elements.material.extension
        self._noise = 1e-14 * elements.modulus * elements.volumes.sum()
        fixed = int(solver._constraints.constrained.sum())
        self._floor = max(1e-4 * elements.modulus * elements.edge**2 * np.sqrt(fixed), np.finfo(float).tiny)
        self._u, self._trial, self._start = zeros(nodes, 3), zeros(nodes, 3), zeros(nodes, 3)
        self._gradient, self._direction = zeros(free, 3), zeros(free, 3, dtype=torch.float32)
        self._energy, self._least, self._step, self._slope, self._reaction = (zeros() for _ in range(5))
        self._residual, self._goal, self._tolerance = zeros(), zeros(), zeros()
        self._steps, self._changes = (zeros(MEMORY, free, 3, dtype=torch.float32) for _ in range(2))
        self._products, self._age = zeros(MEMORY, MEMORY), zeros(MEMORY, dtype=torch.long)
        self._fresh, self._halvings = zeros(dtype=torch.bool), zeros(dtype=torch.long)
        self._iterations, self._code = zeros(dtype=torch.long), zeros(dtype=torch.long) + IDLE
        self._known = zeros(len(elements.patch_volumes), dtype=torch.bool)
        self._told = zeros(8)
        self._zone = (zone if device.type == "cpu" else _zone_gpu()).Zone(elements, solver._free, plans, device)
        self._ready = False
        self._prepare = Recorded(lambda: self._zone.prepare(self._known), device)
        self._place, self._judge = Recorded(self._placed, device), Recorded(self._judged, device)

    def run(self, motions: Tensor) -> tuple[np.ndarray, list[list[dict]]]:
        """As :meth:`BatchSolver.fields`."""
        fields, linear = torch.empty_like(motions), torch.empty_like(motions)
        for at in range(0, len(motions), self.plans):
            part = motions[at : at + self.plans].permute(1, 2, 0).contiguous()
            linear[at : at + self.plans] = self._solver.linear(part).permute(2, 0, 1)
        ways = [_Way() for _ in motions]
        owner, waiting = np.full(self.plans, -1), deque(range(len(motions)))
        self._fill(owner, np.arange(self.plans), waiting, ways, linear)
        while (owner >= 0).any():
            if not self._ready:
                self._prepare()
            self._place()
            self._zone.settle(self._trial, self._goal, self._code == RUNNING)
            self._judge()
            told = self._told.cpu().numpy()
            codes, self._ready = told[0].astype(int), not told[6].any()
            for slot in np.flatnonzero((owner >= 0) & (told[7] == 0)):
                ways[owner[slot]].note(told[:6, slot])
            ended = np.flatnonzero((owner >= 0) & (codes != RUNNING))
            if len(ended):
                strayed = self._strayed()
                at = torch.as_tensor(ended, device=fields.device)
                fields[torch.as_tensor(owner[ended], device=fields.device)] = self._u[:, :, at].permute(2, 0, 1)
                for slot in ended[::-1]:
                    plan = owner[slot]
                    if ways[plan].goes_on(codes[slot] == SOLVED, strayed[slot], fields[plan]):
                        waiting.appendleft(plan)
                self._fill(owner, ended, waiting, ways, linear)
        return fields.cpu().numpy(), [way.record for way in ways]

    def _fill(self, owner, slots, waiting: deque, ways: list["_Way"], linear: Tensor) -> None:
        """Give the next plans, or parts of a load, to slots (s,) whose own have ended."""
        owner[slots] = -1
        device = linear.device
        self._code[torch.as_tensor(slots, device=device)] = IDLE
        slots = slots[: len(waiting)]
        if not len(slots):
            return
        owner[slots] = plans = [waiting.popleft() for _ in slots]
        begin = torch.stack([ways[plan].start(linear[plan]) for plan in plans], dim=2)
        limits = [self._options.tolerance if ways[plan].whole else self._options.loose for plan in plans]
        at = torch.as_tensor(slots, device=device)
        for field in (self._u, self._start):
            field[:, :, at] = begin
        self._tolerance[at] = torch.as_tensor(limits, dtype=torch.float64, device=device)
        self._direction[:, :, at] = 0
        self._age[:, at] = 0
        self._known[:, at] = self._ready = False
        for numbers, value in ((self._fresh, True), (self._halvings, 0), (self._iterations, 0), (self._code, RUNNING)):
            numbers[at] = value

    def _placed(self) -> None:
        """One step of every plan whose last one was judged."""
        trial = self._u.index_add(0, self._solver._nodes, self._step * self._direction)
        self._trial.copy_(torch.where(self._zone.open, self._trial, trial))

    def _judged(self) -> None:
        """Take the trial where it is good, else halve the step; find the next direction."""
        solver, running = self._solver, (self._code == RUNNING) & ~self._zone.open
        state = solver._mesh.measure(self._trial, self._law)
        hard = (state.ratio < repeated.HARD_RATIO) | (state.stretch > repeated.HARD_STRETCH)
        new = (solver._mesh.of_patches(hard.double()) > 0) & ~self._known & running
        self._known |= self._zone.wide(new)
        again = new.any(0)
        force, least = state.force[solver._nodes], state.ratio.amin(0)
        size, reaction = (torch.linalg.vector_norm(item, dim=(0, 1)) for item in (force, state.force[solver._fixed]))
        reaction = reaction.clamp(min=self._floor)
        noise = self._noise + 1e-13 * self._energy.abs()
        falls = state.energy <= self._energy + 1e-4 * self._step * self._slope + noise
        allowed = torch.where(self._least > 0, 0.0, -torch.inf)
        good = running & ~again & torch.isfinite(state.energy) & ((falls & (least > allowed)) | self._fresh)
        bad = running & ~again & ~good
        self._remember(good & ~self._fresh, force)
        for old, value in (
            (self._u, self._trial),
            (self._gradient, force),
            (self._energy, state.energy),
            (self._least, least),
            (self._reaction, reaction),
            (self._residual, size / reaction),
        ):
            old.copy_(torch.where(good, value, old))
        self._iterations += good & ~self._fresh
        self._halvings.copy_(torch.where(good, 0, self._halvings + bad.long()))
        direction, slope = self._next()
        self._direction.copy_(torch.where(good, direction, self._direction))
        self._slope.copy_(torch.where(good, slope, self._slope))
        self._step.copy_(torch.where(good, 1.0, torch.where(bad, self._step / 2, self._step)))
        outside = torch.maximum(SETTLED * size, 0.3 * self._tolerance * reaction)
        goal = torch.where(again & self._fresh, 0.02 * size, self._goal)
        self._goal.copy_(torch.where(good, 0.3 * outside, goal))
        self._fresh &= ~good
        near = good & (self._residual <= self._options.loose)
        failed = (self._halvings > HALVINGS) | (self._iterations >= repeated.ITERATIONS) | (near & ~(self._least > 0))
        failed |= good & (self._iterations == repeated.PATIENCE) & (self._residual > repeated.FAR)
        solved = good & (self._residual <= self._tolerance) & (self._least > 0)
        failed |= good & ~solved & ~(self._slope < 0)
        self._code.copy_(torch.where(running & solved, SOLVED, torch.where(running & failed, FAILED, self._code)))
        told = self._code, self._residual, self._energy, self._least, self._iterations, self._step, again
        self._told.copy_(torch.stack([item.double() for item in (*told, self._zone.open)]))

    def _remember(self, good: Tensor, force: Tensor) -> None:
        """Keep the step to the trial and the change of the force in place of the oldest pair."""
        solver = self._solver
        step = (self._trial[solver._nodes] - self._u[solver._nodes]).float()
        change = (force - self._gradient).float()
        both, one, two = _products(step, change)
        good = good & (both > 1e-12 * torch.sqrt(one * two))
        oldest = self._age.argmin(0)
        here = (torch.arange(MEMORY, device=oldest.device)[:, None] == oldest) & good
        wide = here[:, None, None]
        self._steps.copy_(torch.where(wide, step, self._steps))
        self._changes.copy_(torch.where(wide, change, self._changes))
        self._age.copy_(torch.where(here, self._age.amax(0) + 1, self._age))
        by_step, by_change = _against(self._changes, step), _against(self._steps, change)
        self._products.copy_(torch.where(here[:, None], by_step, self._products))
        self._products.copy_(torch.where(here[None, :], by_change[:, None], self._products))

    def _next(self) -> tuple[Tensor, Tensor]:
        """Minus the product of the inverse Hessian that L-BFGS knows with the gradient, and its slope (k,).

        With pairs by age, s_i' y_j in `upper`: the two loops are two triangular systems.
        """
        solver, gradient = self._solver, self._gradient.float()
        order = self._age.argsort(0)  # empty places first
        there = torch.gather(self._age, 0, order) > 0
        products = self._products.permute(2, 0, 1)
        rank = order.T
        products = products.gather(1, rank[:, :, None].expand_as(products))
        products = products.gather(2, rank[:, None, :].expand_as(products))
        mask = there.T
        eye = torch.eye(MEMORY, dtype=products.dtype, device=products.device)
        upper = torch.where(mask[:, :, None] & mask[:, None, :], products, eye).triu()
        against = torch.gather(_against(self._steps, gradient), 0, order) * there
        shares = torch.linalg.solve_triangular(upper, against.T[:, :, None], upper=True)
        q = gradient - _combined(self._changes, _in_place(shares, order))
        q = _unwarped(self._warp(), q)
        q = _warped(self._warps, solver._fronts.solve(q))
        against = torch.gather(_against(self._changes, q), 0, order) * there
        right = upper.diagonal(dim1=1, dim2=2)[:, :, None] * shares - against.T[:, :, None]
        rest = torch.linalg.solve_triangular(upper.mT, right, upper=False) * mask[:, :, None]
        direction = -(q + _combined(self._steps, _in_place(rest, order)))
        return direction, (direction * self._gradient).sum((0, 1))

    def _warp(self) -> Tensor:
        """Mean deformation gradients (f, 3, 3, k) of the free nodes, of determinant 1."""
        mean = self._solver._gradients(self._u.float()).view(-1, 3, 3, self.plans)
        self._warps = _kept_volume(mean)
        return self._warps

    def _strayed(self) -> np.ndarray:
        """Plans (k,) bool of which a node is far from those beside it: they may have found another equilibrium."""
        way = self._u - self._start
        far = torch.linalg.vector_norm(way - self._solver._beside(way), dim=1).amax(0)
        return (far > repeated.STRAY * self._solver._elements.edge).cpu().numpy()


def _zone_gpu():
    from pinnochio.mechanics.batched import zone_gpu

    return zone_gpu


class _Way:
    """How far one plan has come: it begins with the whole load, and what fails goes on in increments, as in
    :mod:`pinnochio.mechanics.repeated`. record: its steps."""

    def __init__(self):
        self.record: list[dict] = []
        self._done, self._share, self._field, self._spent = 0.0, 1.0, None, 0

    @property
    def whole(self) -> bool:
        """Whether the load is the whole one."""
        return self._done + self._share >= 1

    def start(self, linear: Tensor) -> Tensor:
        """Where the next part of the load begins, (n, 3) mm, linear (n, 3) mm the linear field of the whole."""
        begin = (min(self._done + self._share, 1.0) - self._done) * linear
        return begin if self._field is None else self._field + begin

    def note(self, told) -> None:
        """Keep what a step came to."""
        names = "code", "residual", "energy", "min_jacobian", "iterations", "step"
        self.record.append(dict(zip(names, told.tolist(), strict=True)))
        self.record[-1]["iterations"] += self._spent
        self.record[-1]["fraction"] = min(self._done + self._share, 1.0)

    def goes_on(self, solved: bool, strayed: bool, field: Tensor) -> bool:
        """Whether a part of the load is left to do after one that ended with a field (n, 3) mm."""
        last = self.record[-1]
        self._spent = last["iterations"]
        if solved and strayed and self._share > repeated.LEAST_INCREMENT:
            last |= {"code": FAILED, "reason": "a node strayed from those beside it"}
        if last["code"] == SOLVED:
            self._done, self._field = last["fraction"], field.clone()
            return self._done < 1
        self._share = min(self._share / 2, repeated.INCREMENT)
        return self._share >= repeated.LEAST_INCREMENT


def _result(field, record: list[dict], seconds: float) -> SolveResult:
    end = record[-1]
    names = "fraction", "residual", "energy", "min_jacobian", "step"
    return SolveResult(
        displacement=field,
        converged=True,
        reason="converged",
        history=[{"kind": "kept"} | {name: entry[name] for name in names} for entry in record],
        min_jacobian=end["min_jacobian"],
        fraction=1.0,
        residual=end["residual"],
        violation=0.0,
        penetration=0.0,
        gap=0.0,
        increments=1,
        iterations=int(end["iterations"]),
        factorizations=0,
        linear_iterations=int(end["iterations"]),
        seconds=seconds,
        kept=True,
    )


def _by_patch(elements: Elements) -> Elements:
    """The elements in the order of their patches, so that neighbouring lanes read neighbouring ones."""
    order, law = np.argsort(elements.patch, kind="stable"), elements.material
    return replace(
        elements,
        cells=elements.cells[order],
        gradients=elements.gradients[order],
        volumes=elements.volumes[order],
        patch=elements.patch[order],
        material=replace(law, mu=law.mu[order], lam=law.lam[order], stiffening=law.stiffening[order]),
    )


def _stiffness(elements: Elements) -> sparse.csr_array:
    """The tangent at rest (3n, 3n), zero at nodes without elements."""
    rest = np.zeros((elements.nodes, 3))
    whole = Assembler(elements, np.zeros(rest.shape, bool), np.zeros(0, int))
    upper = whole.upper(whole.tangent(rest, np.zeros((0, 3, 3)))[0])
    full = (upper + sparse.triu(upper, 1).T).tocoo()
    place = np.flatnonzero(whole.free)
    return sparse.csr_array((full.data, (place[full.row], place[full.col])), (rest.size, rest.size))


def _part(matrix: sparse.csr_array, rows, columns) -> sparse.csr_array:
    """The rows and columns (3 per node) of some nodes."""
    rows, columns = ((3 * np.asarray(nodes)[:, None] + np.arange(3)).ravel() for nodes in (rows, columns))
    return matrix[rows][:, columns]


def _in_place(shares: Tensor, order: Tensor) -> Tensor:
    """Shares (k, MEMORY, 1) by age as (MEMORY, k) by place."""
    return torch.zeros_like(shares[:, :, 0].T).scatter(0, order, shares[:, :, 0].T)


@fused
def _products(step, change):
    step, change = step.double(), change.double()
    return (step * change).sum((0, 1)), (step * step).sum((0, 1)), (change * change).sum((0, 1))


@fused
def _against(pairs, x):
    return (pairs * x).sum((1, 2)).double()


@fused
def _combined(pairs, shares):
    return (pairs * shares.float()[:, None, None]).sum(0)


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
def _unwarped(warp, q):
    return (warp * q[:, :, None]).sum(1)


@fused
def _warped(warp, q):
    return (warp * q[:, None]).sum(2)
