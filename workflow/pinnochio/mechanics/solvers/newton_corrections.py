"""Newton corrections: from a prediction towards equilibrium, with the interface where the network puts it."""

import time
import weakref
from dataclasses import dataclass

import numpy as np

from pinnochio.compiled import compiled
from pinnochio.errors import InputError
from pinnochio.mechanics.boundary.conditions import BoundaryConditions
from pinnochio.mechanics.boundary.loads import Loads
from pinnochio.mechanics.elements.materials import Material
from pinnochio.mechanics.elements.tetrahedra import VOLUMETRIC, ElementArrays, Elements, deformation, patch_bulk
from pinnochio.mechanics.settings import FemSettings, SolverSettings
from pinnochio.mechanics.solvers.inversion_repair import Repair, repair_inversions
from pinnochio.mechanics.solvers.newton import Newton, NewtonState, Stop
from pinnochio.model.patient import FIXED, FREE, NO_INTERFACE, PatientModel

# Shares of a Newton step that are tried in turn.
SHARES = tuple(0.5**halvings for halvings in range(20))
# Elements squeezed below this J, or stretched above its inverse, enter the first tangent without the negative
# eigenvalues of their Hessian: some twenty of 80,000 make the tangent of a raw field indefinite, and to cut those of
# all takes five times as long as the rest of a correction [X].
CUT_BELOW = 0.5
EQUILIBRIUM = 1e-2  # residual of what is given out: the face moves by hundredths of a millimetre below it [X]


@dataclass(frozen=True)
class Correction:
    """displacement (n, 3) mm after some corrections; the first of a list is the start itself.

    seconds: since the start, all corrections before included; residual: force on the free nodes over that on the
    prescribed ones; least: smallest J; share: how much of the Newton step was taken; gap: largest distance of a
    prescribed node from where it belongs, mm.
    """

    displacement: np.ndarray
    seconds: float
    residual: float
    least: float
    share: float
    gap: float


class Corrector:
    """Newton corrections of fields on one mesh with the nodes `prescribed` (p,); serves every plan.

    points (n, 3) mm, cells (m, 4); loads: their springs and tension act under every plan. Each correction solves its
    system by conjugate gradients on the factors of an earlier one of the same plan, or on its own where that costs
    less, as the solver does. Factors of the tangent at rest, which serve every plan, were tried: they take 14 to 24
    iterations where those of the first correction take 4 to 8, more than the one factorisation that they save costs
    [X].
    """

    def __init__(
        self,
        points,
        cells,
        material: Material,
        prescribed,
        volumetric: str = VOLUMETRIC[0],
        linear_solver: str = "auto",
        loads: Loads | None = None,
    ):
        self._nodes = np.asarray(prescribed, int)
        self._motion = np.zeros((len(self._nodes), 3))  # of these nodes, mm, under the plan at hand
        self._cells, self._material = np.asarray(cells), material
        options = SolverSettings(
            volumetric=volumetric,
            increments=1,
            tolerance=1e-6,
            max_iterations=25,
            max_systems=1000,
            linear_solver=linear_solver,
        )
        boundary = BoundaryConditions(self._nodes, lambda fraction: self._motion, loads=loads)
        self._newton = Newton(points, cells, material, boundary, options)

    @classmethod
    def of(cls, patient: PatientModel, settings: FemSettings, nodes, loads: Loads | None = None) -> "Corrector":
        """Corrections on a patient's mesh with prescribed nodes (p,), by the study's law and solver."""
        law = settings.material(patient.tissue)
        return cls(patient.points, patient.cells, law, nodes, settings.volumetric, settings.linear_solver, loads)

    def corrections(
        self, start, prescribed, steps: int, tolerance: float = 0.0, forces=None, alike: bool = False
    ) -> list[Correction]:
        """The start (n, 3) mm and what 1, 2, ... `steps` corrections make of it; fewer where one meets the tolerance
        (residual) or none gets any further.

        alike: the field is of the same plan as the one before, whose factors serve it too.
        prescribed (p, 3) mm: where the prescribed nodes belong. Where that turns an element inside out which no free
        node can save, they belong where `repair_inversions` puts them.
        forces (n, 3) mN: a dead load, if there is one. InputError if a field does not fit the mesh or is not finite.
        """
        newton, start = self._newton, np.array(start, float)
        if start.shape != newton.points.shape or np.shape(prescribed) != self._motion.shape:
            problem = f"start {start.shape} and prescribed {np.shape(prescribed)} do not fit the mesh"
            raise InputError("-", "start", problem, f"give {newton.points.shape} and {self._motion.shape} in mm")
        began = time.perf_counter()
        self._motion = self._attainable(start, prescribed)
        newton.outer = newton.outer.under(forces)
        if not alike:
            newton.forget()  # what one plan leaves behind must not change the next one's result
        # No pressure to begin with: that of a field which is far from equilibrium is spurious.
        pressure, cut_below = np.zeros(len(newton.elements.patch_volumes)), CUT_BELOW
        state, share, made = newton.measured(start, 1.0), 0.0, []
        while True:
            gap = np.linalg.norm(state.u[self._nodes] - self._motion, axis=1).max(initial=0.0)
            seconds = time.perf_counter() - began if made else 0.0
            made.append(Correction(state.u, seconds, state.residual, state.least, share, float(gap)))
            if len(made) > steps or (state.residual <= tolerance and gap == 0):
                return made
            last, (state, share) = state, self._corrected(state, pressure, cut_below)
            if not share:
                return made
            if len(made) < steps:
                pressure = expected_pressure(newton.elements, last.u, state.u - last.u)
                cut_below = 0.0  # equilibrium is approached by the whole tangent

    def close(self) -> None:
        """Release the factors."""
        self._newton.close()

    def _corrected(self, state: NewtonState, pressure, cut_below: float) -> tuple[NewtonState, float]:
        """The state after one correction and the share of its step that was taken; 0 where none helps.

        The way of the prescribed nodes is a part of the step. The tangent takes the patches' pressures (p,) that the
        last step expected to first order: those of the volumes hold the second-order error of that step, times lambda,
        which makes tangents indefinite and Newton's method slow where lambda is large against mu [R: Magisano,
        Leonetti, Garcea 2017, for all stresses]. Equilibrium is the same. From 25 elastic fields a residual of 1e-3
        took 2 to 5 corrections so, 2 to 8 by Newton's own tangent [X].
        """
        newton = self._newton
        moving = (self._motion != state.u[self._nodes]).any()
        try:
            direction = newton.predict(state, 1.0, pressure, cut_below).motion
        except Stop:
            return state, 0.0
        slope = float(np.einsum("ij,ij->", direction, state.force))
        for share in SHARES:
            u = state.u + share * direction
            if share == 1:
                u[self._nodes] = self._motion  # to the last bit
            new = newton.measured(u, 1.0)
            # While the boundary moves the energy may rise.
            if new.least > newton.least_allowed(state) and (moving or newton.falls(state, new, share * slope)):
                return new, share
        return state, 0.0

    def _attainable(self, start, prescribed) -> np.ndarray:
        """Where the prescribed nodes (p, 3) mm can go without an inverted element."""
        moved, interface = start.copy(), np.zeros(len(start), bool)
        moved[self._nodes], interface[self._nodes] = prescribed, True
        newton = self._newton
        repaired, _ = repair_inversions(
            newton.points, self._cells, self._material, moved, interface, newton.settings.volumetric
        )
        return repaired[self._nodes]


class Finish:
    """The end of every network's prediction on one patient: the inversion repair, then Newton corrections, `steps` at
    most and none below a residual of EQUILIBRIUM; loads: as of the :class:`Corrector`."""

    def __init__(self, patient: PatientModel, settings: FemSettings, steps: int, loads: Loads | None = None):
        self._patient, self._settings, self._steps, self._loads = patient, settings, steps, loads
        self._corrector: Corrector | None = None

    def __call__(self, displacement, boundary, forces=None, alike: bool = False) -> tuple[np.ndarray, Repair, int]:
        """Displacement (n, 3) mm, what the inversion repair did, and how many corrections were made; as of `all`."""
        made, repair = self.all(displacement, boundary, forces, alike)
        return made[-1].displacement, repair, len(made) - 1

    def all(self, displacement, boundary, forces=None, alike: bool = False) -> tuple[list[Correction], Repair]:
        """The repaired field and what each correction makes of it, down to EQUILIBRIUM, and the repair.

        displacement, boundary (n, 3) mm, forces (n, 3) mN: the network's. alike: another network's field of the same
        plan was finished just before.
        """
        patient, settings = self._patient, self._settings
        law = settings.material(patient.tissue)
        displacement, repair = repair_inversions(
            patient.points, patient.cells, law, displacement, patient.node_type != FREE, settings.volumetric
        )
        if not self._steps:
            return [Correction(displacement, 0.0, np.nan, repair.least, 0.0, np.nan)], repair
        nodes, prescribed = interface(patient, boundary)
        if self._corrector is None:
            self._corrector = Corrector.of(patient, settings, nodes, self._loads)
            weakref.finalize(self, self._corrector.close)
        return self._corrector.corrections(displacement, prescribed, self._steps, EQUILIBRIUM, forces, alike), repair


def interface(patient: PatientModel, boundary) -> tuple[np.ndarray, np.ndarray]:
    """Nodes (p,) that corrections prescribe and where they belong (p, 3) mm: `boundary` (n, 3), cut planes at rest."""
    cut = (patient.node_type == FIXED) & (patient.interface_kind == NO_INTERFACE)
    nodes = np.flatnonzero(patient.node_type != FREE)
    return nodes, np.where(cut[:, None], 0.0, boundary)[nodes]


def expected_pressure(elements: Elements, displacement, change) -> np.ndarray:
    """Pressure (p,) in kPa of every patch after a change (n, 3) mm of the displacement (n, 3) mm, to first order."""
    pressure, slope, rates = (np.zeros(len(elements.patch_volumes)) for _ in range(3))
    u, step = (np.ascontiguousarray(x, float) for x in (displacement, change))
    patch_bulk(u, elements.arrays, pressure, slope)
    _volume_rates(u, step, elements.arrays, rates)
    return pressure + slope * rates / elements.patch_volumes


@compiled
def _volume_rates(u, step, mesh: ElementArrays, rates):
    """Adds to every patch the first-order change of its volume under `step`."""
    f, cof = np.empty((3, 3)), np.empty((3, 3))
    for e in range(len(mesh.cells)):
        cell, gradients = mesh.cells[e], mesh.gradients[e]
        deformation(u, cell, gradients, f, cof)
        rate = 0.0
        for a in range(4):
            for i in range(3):
                for j in range(3):
                    rate += cof[i, j] * gradients[a, j] * step[cell[a], i]
        rates[mesh.patch[e]] += mesh.volumes[e] * rate
