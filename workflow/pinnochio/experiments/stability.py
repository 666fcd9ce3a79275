"""The stability sweep: what solver, elastic path and physics loss do at the extremes, cell by cell, and its table."""

import logging
import os
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import pandas as pd

from pinnochio.errors import InputError
from pinnochio.experiments import stability_problems as problems
from pinnochio.experiments.stability_judge import (
    CLEAN,
    CONVERGED,
    OUTCOMES,
    WRONG,
    Verdict,
    judge_elastic,
    judge_loss,
    judge_solution,
    slope_of,
)
from pinnochio.experiments.stability_problems import FAMILIES, PRECISIONS, Problem
from pinnochio.mechanics.elastic import ElasticSolver
from pinnochio.mechanics.elements import VOLUMETRIC
from pinnochio.mechanics.settings import FemSettings
from pinnochio.mechanics.simulation import solver_options
from pinnochio.mechanics.solver import solve
from pinnochio.model.patient import PatientModel
from pinnochio.seeds import generator
from pinnochio.tables.engine import Column, View, write_csv, write_twins

LOG = logging.getLogger(__name__)
MOVEMENTS = ("translation", "rotation")
METHODS = ("solver", "elastic", "loss")
STABILITY = (
    Column("family", str, "", f"what is taken to its extreme: {', '.join(FAMILIES)}"),
    Column("setting", float, "", "how far", "g"),
    Column("unit", str, "", "unit of the setting, - without one"),
    Column("method", str, "", "solver, elastic (linear path) or loss (physics loss and its gradient)"),
    Column("element", str, "", "volume term"),
    Column("precision", str, "", "of the arrays handed over; the loss computes in it, the solvers in float64"),
    Column(
        "outcome", str, "", "converged and confirmed, failed cleanly, or wrong, in the eyes of an independent judge"
    ),
    Column("reason", str, "", "why"),
    Column("min_jacobian", float, "", "smallest det F of the state", ".4f", optional=True),
    Column(
        "residual", float, "", "relative force on free unknowns; of the loss, its largest error", ".1e", optional=True
    ),
    Column("seconds", float, "s", "of the method, without the judge", ".3f"),
    Column("case", str, "", "patient, or block"),
    Column("seed", int, "", "seed of the study"),
    Column("device", str, "", "device that computed"),
    Column("code", str, "", "content hash of the code"),
)


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


def label(setting: float, unit: str) -> str:
    """A setting with its unit."""
    return f"{setting:g} {unit}".removesuffix(" -")


def check_outcomes(frame: pd.DataFrame) -> None:
    """RuntimeError that names every wrong cell, if there is one."""
    wrong = frame[frame["outcome"] == WRONG]
    if len(wrong):
        cells = [
            f"{row.family} {label(row.setting, row.unit)}, {row.method} {row.element} {row.precision}: {row.reason}"
            for row in wrong.itertuples()
        ]
        raise RuntimeError(f"{len(cells)} of {len(frame)} cells are wrong:\n" + "\n".join(cells))


def write_stability(rows: Sequence[Mapping], path: str | os.PathLike) -> None:
    """Write stability.csv, one row per cell, and its twins, which count by family and method; refuses wrong cells."""
    frame = pd.DataFrame(rows)
    check_outcomes(frame)
    frame = write_csv(frame, path, STABILITY)
    form = {column.name: column for column in STABILITY}
    groups = []
    for (family, method), own in frame.groupby(["family", "method"], sort=False):
        failed = own[own["outcome"] == CLEAN]
        done = own[own["outcome"] == CONVERGED]
        settings = own.drop_duplicates("setting")
        groups.append(
            {
                "family": family,
                "settings": ", ".join(label(x, FAMILIES[family]) for x in settings["setting"]),
                "method": method,
                **{outcome: int((own["outcome"] == outcome).sum()) for outcome in OUTCOMES},
                "least J": form["min_jacobian"].text(done["min_jacobian"].min()),
                "residual": form["residual"].text(done["residual"].max()),
                "ends": ", ".join(
                    f"{label(row.setting, row.unit)} {row.element} {row.precision}" for row in failed.itertuples()
                ),
            }
        )
    view = [
        View("Family", lambda row: row["family"]),
        View("Settings", lambda row: row["settings"]),
        View("Method", lambda row: row["method"]),
        *(View(outcome, lambda row, outcome=outcome: row[outcome]) for outcome in OUTCOMES),
        View("Least J", lambda row: row["least J"]),
        View("Largest residual or error", lambda row: row["residual"]),
        View("Failed cleanly at", lambda row: row["ends"]),
    ]
    caption = (
        f"Stability sweep: {len(frame)} cells, each judged independently of what it judges. Least J and residual are "
        "those of the converged cells; the elastic path is linear, and the loss is taken at a raw network's state, so "
        "that their J may be negative."
    )
    write_twins(pd.DataFrame(groups), path, view, caption, STABILITY)
