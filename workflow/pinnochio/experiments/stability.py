"""The stability sweep: what solver, elastic path and physics loss do at the extremes, cell by cell."""

import logging
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from pinnochio.errors import InputError
from pinnochio.experiments import stability_problems as problems
from pinnochio.experiments.stability_judge import Verdict, judge_elastic, judge_loss, judge_solution, slope_of
from pinnochio.experiments.stability_problems import PRECISIONS, Problem
from pinnochio.mechanics.elastic import ElasticSolver
from pinnochio.mechanics.elements import VOLUMETRIC
from pinnochio.mechanics.settings import FemSettings
from pinnochio.mechanics.simulation import solver_options
from pinnochio.mechanics.solver import solve
from pinnochio.model.patient import PatientModel
from pinnochio.seeds import generator
from pinnochio.tables.stability import CLEAN, CONVERGED, FAMILIES, WRONG

LOG = logging.getLogger(__name__)
MOVEMENTS = ("translation", "rotation")
METHODS = ("solver", "elastic", "loss")


@dataclass
class Sweep:
    """Every cell, setting by setting.

    model: the patient of the movements, `case` its name; config: the configuration's section `stability`; fem: solver
    settings and the patient's tissues; extension, loss: of :func:`judge_loss`.
    """

    case: str
    model: PatientModel
    config: Mapping
    fem: FemSettings
    extension: float
    loss: Callable
    seed: int
    block_fields: dict = field(default_factory=dict)

    def rows(self) -> Iterator[dict]:
        """One row per cell, in the order of the table, logged as it is measured."""
        for family in FAMILIES:
            for value in self.config[family]:
                for row in self.setting(family, float(value)):
                    LOG.info("%s", ", ".join(str(x) for x in row.values()))
                    yield row

    def setting(self, family: str, value: float) -> list[dict]:
        """The rows of one setting, methods in the order of METHODS."""
        case = self.case if family in MOVEMENTS else "block"
        key = {"family": family, "setting": value, "unit": FAMILIES[family]}
        rows = []
        for element in VOLUMETRIC:
            known: dict[str, np.ndarray] = {}
            if family in ("inverted", "unit"):
                known = dict(self.block_field(element))
            for precision in PRECISIONS:
                problem = self.problem(family, value, precision)
                for method, verdict, seconds in self.cells(problem, element, precision, family, value, known):
                    rows.append(
                        key
                        | {"method": method, "element": element, "precision": precision}
                        | vars(verdict)
                        | {"seconds": seconds, "case": case}
                    )
        return sorted(rows, key=lambda row: METHODS.index(row["method"]))

    def cells(self, problem: Problem, element: str, precision: str, family: str, value: float, known: dict):
        """Method, verdict and seconds of each cell of a problem.

        known: fields in mm by method that later ones must agree with; the first of each method is added to it.
        """
        options = replace(solver_options(self.fem), volumetric=element)

        def linear():
            solver = ElasticSolver(
                problem.points, problem.cells, problem.material, problem.boundary, element, self.fem.linear_solver
            )
            try:
                return solver.solve(problem.boundary)
            finally:
                solver.close()

        elastic, verdict, seconds = attempt(
            linear, lambda field, _: judge_elastic(problem, element, field, known.get("elastic"))
        )
        if elastic is not None:
            known.setdefault("elastic", elastic * problem.millimetres)
        # The same for both elements and precisions.
        rng = generator(self.seed, "stability", f"{family}/{value:g}")
        if family == "inverted":
            # Linear theory has no start.
            state = problems.tangled(problem, known["solver"], value / 100, rng)
            start = state
        else:
            yield "elastic", verdict, seconds
            # What a user hands over in single precision is a network's field; in double precision the solver gets none.
            state = start = np.zeros_like(problem.points) if elastic is None else elastic
            state = state + rng.normal(0, self.config["noise"] / problem.millimetres, state.shape)
            start = None if precision == "float64" else start
        if start is not None:
            start = start.astype(precision)

        # A long movement has several equilibria: sliding nodes can settle on either side of an edge of the bone.
        unique = family not in MOVEMENTS

        def newton():
            return solve(problem.points, problem.cells, problem.material, problem.boundary, options, start)

        def judge(result, seconds):
            return judge_solution(problem, element, result, seconds, options, known.get("solver"), unique)

        result, verdict, seconds = attempt(newton, judge)
        if verdict.outcome == CONVERGED:
            known.setdefault("solver", result.displacement * problem.millimetres)
        yield "solver", verdict, seconds

        single = state.astype(np.float32).astype(float)

        def loss(kind):
            return slope_of(problem, element, kind, single, self.extension, self.loss)

        def judge_slope(slope, _):
            exact = slope if precision == "float64" else loss("float64")
            return judge_loss(problem, element, precision, single, slope, exact, self.extension, rng)

        _, verdict, seconds = attempt(lambda: loss(precision), judge_slope, refusals=(InputError,))
        yield "loss", verdict, seconds

    def problem(self, family: str, value: float, precision: str) -> Problem:
        """The problem of a setting."""
        if family in MOVEMENTS:
            segment = self.config["segment"]
            motion = problems.forward(value) if family == "translation" else problems.pitch(self.model, segment, value)
            return problems.movement(self.model, segment, motion, self.fem, precision)
        name = "millimetres" if family == "unit" else family
        changed = {} if family == "inverted" else {name: value}
        return problems.block(tuple(self.config["block"]), precision, **changed)

    def block_field(self, element: str) -> dict[str, np.ndarray]:
        """Fields in mm, by method, of the block as it is."""
        if element not in self.block_fields:
            problem = problems.block(tuple(self.config["block"]))
            known: dict[str, np.ndarray] = {}
            for _ in self.cells(problem, element, "float64", "unit", 1.0, known):
                pass
            if "solver" not in known:
                raise RuntimeError(f"the block problem itself is not solved with the element {element!r}; see the log")
            self.block_fields[element] = known
        return self.block_fields[element]


def attempt(
    compute: Callable, judge: Callable, refusals: tuple[type[Exception], ...] = (InputError, RuntimeError)
) -> tuple[object, Verdict, float]:
    """Result (None if there is none), verdict and seconds; judge(result, seconds) gives the verdict.

    refusals: errors that say what is the matter. Any other is wrong, and so is one of a subclass or without a word.
    """
    began = time.perf_counter()
    try:
        result = compute()
        seconds = time.perf_counter() - began
        return result, judge(result, seconds), seconds
    except Exception as error:
        outcome = CLEAN if type(error) in refusals and str(error) else WRONG
        reason = str(error) if outcome == CLEAN else f"{type(error).__name__}: {error}"
        return None, Verdict(outcome, reason), time.perf_counter() - began
