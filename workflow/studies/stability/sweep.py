"""The stability sweep: what the solvers, maps, repairs and corrections do at the extremes, cell by cell."""

import logging
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import closing
from dataclasses import dataclass, field, replace

import numpy as np

from pinnochio.errors import InputError
from pinnochio.mechanics.elements.tetrahedra import VOLUMETRIC
from pinnochio.mechanics.lift import Lift, make_lift, motion_amplitudes
from pinnochio.mechanics.settings import FemSettings
from pinnochio.mechanics.solvers.inversion_repair import repair_inversions
from pinnochio.mechanics.solvers.kept_factors import KeptFactors
from pinnochio.mechanics.solvers.linear_elasticity import ElasticSolver
from pinnochio.mechanics.solvers.newton import solve
from pinnochio.mechanics.solvers.newton_corrections import Corrector
from pinnochio.methods.pinnochio.predictor import GraphPredictor
from pinnochio.methods.protocol import Planned
from pinnochio.model.patient import PatientModel
from pinnochio.plans.plan import Plan
from pinnochio.seeds import generator
from studies.stability import problems
from studies.stability.judging import (
    Verdict,
    judge_correction,
    judge_elastic,
    judge_network,
    judge_repair,
    judge_solution,
)
from studies.stability.problems import PRECISIONS, Problem
from studies.stability.table import CLEAN, CONVERGED, FAMILIES, OF_PATIENTS, WRONG

LOG = logging.getLogger(__name__)
WHOLE = VOLUMETRIC[0]
EVERY = tuple((element, precision) for element in VOLUMETRIC for precision in PRECISIONS)  # of the block
REFUSALS = (InputError, RuntimeError)
CORRECTIONS = 5  # Newton, of a field


@dataclass
class Sweep:
    """The cells of one family on one case, setting by setting.

    model: the patient, None for the block; way: of the motion, where the family moves segments in one (DIRECTIONS or
    AXES of the problems); config: the configuration's section `stability`; fem: solver settings and the patient's
    tissues; controls: points of the map; network: file of a trained one that predicts new patients, if any, with so
    many corrections.
    """

    family: str
    case: str
    way: str
    model: PatientModel | None
    config: Mapping
    fem: FemSettings
    seed: int
    controls: int = 32
    network: str | None = None
    corrections: int = 0
    _kept: dict = field(default_factory=dict)

    def rows(self) -> Iterator[dict]:
        """One row per cell, logged as it is measured."""
        for value in self.config[self.family]:
            for segment in self.segments():
                for row in self.setting(float(value), segment):
                    LOG.info("%s", ", ".join(str(x) for x in row.values()))
                    yield row

    def segments(self) -> tuple[str, ...]:
        """What is moved: each segment of a patient in turn, where one is, and both jaws where they are shifted."""
        alone = self.model.segments if self.family in OF_PATIENTS else ("-",)
        return (*alone, *[problems.JAWS] * (self.family == "translation"))

    def setting(self, value: float, segment: str) -> Iterator[dict]:
        """The rows of one setting."""
        key = {"family": self.family, "setting": value, "unit": FAMILIES[self.family], "way": self.way}
        cells = self.of_patient if self.family in OF_PATIENTS else self.of_block
        for method, element, precision, verdict, seconds in cells(value, segment):
            yield (
                key
                | {"segment": segment, "method": method, "element": element, "precision": precision}
                | vars(verdict)
                | {"seconds": seconds, "case": self.case}
            )

    def options(self, element: str) -> FemSettings:
        """The solver's, with an element."""
        return replace(self.fem, volumetric=element)

    def rng(self, *names) -> np.random.Generator:
        """Random numbers of a setting: the same for all methods, elements and precisions."""
        return generator(self.seed, "stability", "/".join([self.family, self.case, self.way, *map(str, names)]))

    # ---- the block

    def block(self, value: float | None, precision: str) -> Problem:
        """The block problem at a setting; the plain one where the setting is of the start alone, or none."""
        if self.family == "size":
            return problems.block(problems.steps_of(int(value)), precision)
        name = "millimetres" if self.family == "unit" else self.family
        changed = {} if self.family == "inverted" or value is None else {name: value}
        return problems.block(tuple(self.config["block"]), precision, **changed)

    def of_block(self, value: float, segment: str):
        """The cells of one setting of the block."""
        for element, precision in EVERY if self.family != "size" else ((WHOLE, "float64"),):
            known = dict(self.plain(element)) if self.family in ("inverted", "unit") else {}
            if precision == "float32":
                known = known | self._kept.get((value, element), {})
            problem = self.block(value, precision)
            yield from self.solved(problem, value, element, precision, known)
            self._kept[value, element] = known

    def plain(self, element: str) -> dict[str, np.ndarray]:
        """Fields in mm, by method, of the block as it is."""
        if ("plain", element) not in self._kept:
            problem, known = problems.block(tuple(self.config["block"])), {}
            plain = replace(self, family="unit")
            for _ in plain.solved(problem, 1.0, element, "float64", known):
                pass
            if "solver" not in known:
                raise RuntimeError(f"the block problem itself is not solved with the element {element!r}; see the log")
            self._kept["plain", element] = known
        return self._kept["plain", element]

    # ---- patients

    def of_patient(self, value: float, segment: str):
        """The cells of one setting of a patient."""
        model = self.model
        if self.family == "rough":
            model = problems.roughened(model, self.config["roughness"], self.rng())
        plan = problems.moved(model, segment, self.way, value)
        known: dict[str, np.ndarray] = {}
        problem = problems.movement(model, plan, self.fem)
        yield from self.solved(problem, value, WHOLE, "float64", known, segment)
        yield from self.mapped(problem, model, plan, known)
        if self.network:
            yield self.predicted(problem, model, plan)
        if self.family != "rough":  # which bone it is does not matter there
            held = problems.movement(model, plan, self.fem, "bonded")
            yield self.solution(held, "bonded", WHOLE, "float64", None, unique=False)

    def mapped(self, problem: Problem, model: PatientModel, plan: Plan, known: Mapping):
        """The elastic map of a patient."""
        lift = self.lift(model)

        def spread():
            amplitudes = motion_amplitudes(plan, model.segments, lift.centre)
            return np.tensordot(amplitudes, lift.motions.astype(float), axes=1)

        _, verdict, seconds = attempt(
            spread, lambda field, _: judge_elastic(problem, WHOLE, field, known.get("elastic"), rounded=True)
        )
        yield "map", WHOLE, "float32", verdict, seconds

    def predicted(self, problem: Problem, model: PatientModel, plan: Plan):
        """The trained network of `predict`, with its learned loads, repair and corrections."""
        if "planned" not in self._kept:
            settings = {"fem": vars(self.fem), "newton_corrections": self.corrections}
            self._kept["planned"] = (
                GraphPredictor(settings, self.network, "cpu", 1),
                Planned(self.case, model, plan, self.lift(model), warm=False),
            )
        network, patient = self._kept["planned"]
        _, verdict, seconds = attempt(
            lambda: network(replace(patient, plan=plan)), lambda made, _: judge_network(problem, WHOLE, made, self.fem)
        )
        return "network", WHOLE, "float32", verdict, seconds

    def lift(self, model: PatientModel) -> Lift:
        """The elastic map of the model, made once."""
        if "lift" not in self._kept:
            law = self.fem.material(model.tissue)
            self._kept["lift"] = make_lift(model, law, self.controls, WHOLE)
        return self._kept["lift"]

    # ---- methods

    def solved(self, problem: Problem, value: float, element: str, precision: str, known: dict, segment: str = "-"):
        """The cells of the mechanics on a problem; known: fields in mm by method that later ones must agree with, to
        which the first of each method is added."""

        def linear():
            with closing(ElasticSolver(*problem.posed, element, self.fem.linear_solver)) as solver:
                return solver.solve(problem.boundary)

        elastic, verdict, seconds = attempt(
            linear, lambda field, _: judge_elastic(problem, element, field, known.get("elastic"))
        )
        if elastic is not None:
            known.setdefault("elastic", elastic * problem.millimetres)
        rng = self.rng(f"{value:g}", segment)
        rest = np.zeros(problem.points.shape) if elastic is None else elastic
        wrong_start = self.family == "inverted"
        if wrong_start:
            # Linear theory has no start.
            start = problems.tangled(problem, known["solver"], value / 100, rng)
        else:
            yield "elastic", element, precision, verdict, seconds
            # What a user hands over in single precision is a network's field; in double precision the solver gets none.
            start = rest if precision == "float32" else None
        boundary, start = start, None if start is None else start.astype(precision)
        # A long movement has several equilibria: sliding nodes can settle on either side of an edge of the bone.
        unique = self.family not in OF_PATIENTS
        yield self.solution(problem, "solver", element, precision, known, unique, start)
        if precision == "float64" and not wrong_start:
            yield self.kept(problem, element, known, unique)
        if wrong_start:
            yield from self.finished(problem, element, precision, start.astype(float), boundary.astype(float))

    def solution(self, problem, method, element, precision, known, unique, start=None):
        """Newton's method, from a start or from rest."""
        options = self.options(element)

        def newton():
            return solve(*problem.posed, options, start)

        def judge(result, seconds):
            field = None if known is None else known.get("solver")
            return judge_solution(problem, element, result, seconds, options, field, unique)

        result, verdict, seconds = attempt(newton, judge)
        if known is not None and verdict.outcome == CONVERGED:
            known.setdefault("solver", result.displacement * problem.millimetres)
        return method, element, precision, verdict, seconds

    def kept(self, problem: Problem, element: str, known: Mapping, unique: bool):
        """The factors of the stiffness at rest."""
        options = self.options(element)

        def repeated():
            with closing(KeptFactors(*problem.posed, options)) as solver:
                return solver.solve([problem.boundary])[0]

        def judge(result, seconds):
            return judge_solution(problem, element, result, seconds, options, known.get("solver"), unique)

        result, verdict, seconds = attempt(repeated, judge)
        if result is not None and not result.kept:
            verdict = replace(verdict, reason=f"by Newton's method: {verdict.reason}")
        return "kept", element, "float64", verdict, seconds

    def finished(self, problem, element, precision, raw, boundary):
        """What ends every network's prediction: the inversion repair, then Newton corrections."""
        nodes = np.setdiff1d(np.arange(len(raw)), problem.free)
        interface = np.zeros(len(raw), bool)
        interface[nodes] = True

        def mend():
            return repair_inversions(*problem.posed[:3], raw, interface, element)

        made, verdict, seconds = attempt(mend, lambda result, _: judge_repair(problem, raw, *result))
        yield "repair", element, precision, verdict, seconds
        if made is None:
            return

        def correct():
            with closing(Corrector(*problem.posed[:3], nodes, element, self.fem.linear_solver)) as corrector:
                return corrector.corrections(made[0], boundary[nodes], CORRECTIONS, self.fem.tolerance)

        def judge(result, _):
            return judge_correction(problem, element, result, nodes, boundary[nodes], made[1], self.fem.tolerance)

        _, verdict, seconds = attempt(correct, judge)
        yield "corrections", element, precision, verdict, seconds


def attempt(compute: Callable, judge: Callable) -> tuple[object, Verdict, float]:
    """Result (None if there is none), verdict and seconds; judge(result, seconds) gives the verdict.

    REFUSALS say what is the matter. Any other error is wrong, and so is one of a subclass or without a word.
    """
    began = time.perf_counter()
    try:
        result = compute()
        seconds = time.perf_counter() - began
        return result, judge(result, seconds), seconds
    except Exception as error:
        outcome = CLEAN if type(error) in REFUSALS and str(error) else WRONG
        reason = str(error) if outcome == CLEAN else f"{type(error).__name__}: {error}"
        return None, Verdict(outcome, reason), time.perf_counter() - began
