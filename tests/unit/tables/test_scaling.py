"""Exponents of known growths, what a call costs in a process of its own, and the tables of made-up measurements."""

import time
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest

from pinnochio.columns import read_table, write_csv
from pinnochio.errors import InputError
from pinnochio.experiments import measuring
from pinnochio.experiments.measuring import DONE, measure
from pinnochio.figures.scaling import draw
from pinnochio.files import megabytes
from pinnochio.statistics.growth import fit
from pinnochio.tables.large_cohort import Measured, paragraphs
from pinnochio.tables.scaling import SCALING, size_growths, table
from pinnochio.tables.scaling_exponents import EXPONENTS, exponents
from pinnochio.tables.scaling_patients import PATIENTS, patient_runs, patients
from tests.helpers.rows import benchmark
from tests.helpers.tables import make, texts, write

NODES = np.array([1500, 3000, 6000, 12500, 25000, 50000])


@pytest.mark.parametrize("exponent", [0.7, 1.0, 1.33, 2.0])
@pytest.mark.parametrize("constant", [0.0, 0.5, 5.0])
def test_the_exponent_is_found_whatever_does_not_grow(exponent, constant):
    growth = fit(NODES, constant + 20 * (NODES / 50000) ** exponent)
    assert growth.exponent == pytest.approx(exponent, abs=1e-4) and growth.error < 1e-4
    assert growth.constant == pytest.approx(constant, abs=1e-3) and growth.growing == pytest.approx(20, abs=1e-3)
    assert growth(100000) == pytest.approx(constant + 20 * 2**exponent, rel=1e-3)


def test_the_interval_holds_the_exponent_as_often_as_it_says():
    """Of 100 series with five percent of noise; 0.9, because six points make the 95 % interval a rough one."""
    rng, inside, widths = np.random.default_rng(0), 0, []
    for _ in range(100):
        growth = fit(NODES, (2 + 20 * (NODES / 50000) ** 1.33) * np.exp(0.05 * rng.normal(size=len(NODES))))
        inside += abs(growth.exponent - 1.33) <= growth.error
        widths.append(growth.error)
    assert 0.88 < inside / 100 < 1 and np.median(widths) < 0.4


def test_too_few_sizes_give_no_exponent_or_no_interval():
    assert np.isnan(fit(NODES[:2], [1, 2]).exponent) and fit(NODES[:2], [1, 2]).points == 2
    assert fit(NODES[:3], NODES[:3]).exponent == pytest.approx(1, abs=1e-3) and np.isnan(
        fit(NODES[:3], NODES[:3]).error
    )
    missing = fit(NODES, np.where(NODES == 50000, np.nan, NODES / 1e3))
    assert missing.points == 5 and missing.largest == 25000 and missing.exponent == pytest.approx(1, abs=1e-3)


def test_what_does_not_grow_has_no_interval():
    growth = fit(NODES, [3.1, 2.9, 3.05, 3.0, 3.02, 2.9])
    assert growth(50000) == pytest.approx(3, abs=0.1) and (np.isnan(growth.error) or growth.error > 0.5)


def test_a_sum_over_patients_needs_no_constant():
    growth = fit([5, 10, 20, 40], [50, 101, 199, 402], constant=False)
    assert growth.exponent == pytest.approx(1, abs=0.01) and growth.constant == 0 and 0 < growth.error < 0.05


def test_a_call_is_measured_in_its_own_process():
    began = time.time()
    cost = measure("tests.helpers.measured_calls:hold", {"megabytes": 200, "seconds": 0.3}, 600)
    assert cost.outcome == DONE and cost.seconds - cost.cpu_seconds > 0.25  # it sleeps
    assert np.isfinite(cost.start_seconds) and cost.start_seconds > 0
    assert cost.start_seconds + 2 * cost.seconds <= time.time() - began  # a short call is made twice
    small = measure("tests.helpers.measured_calls:hold", {"megabytes": 0, "seconds": 0}, 600)
    assert cost.memory - small.memory == pytest.approx(200, rel=0.1)


def test_the_start_ends_where_the_call_begins(monkeypatch):
    """By a clock of our own: 2 s until the process runs, 7 s for its modules, 4 s and then 3 s for the call."""
    now, calls = [100.0], iter((4.0, 3.0))
    clock = SimpleNamespace(**dict.fromkeys(("time", "perf_counter"), lambda: now[0]), process_time=lambda: now[0] / 2)

    def pass_time(seconds):
        now[0] += seconds

    def load(name):
        pass_time(7.0)
        return SimpleNamespace(call=lambda: pass_time(next(calls)))

    monkeypatch.setattr(measuring, "time", clock)
    monkeypatch.setattr(measuring, "importlib", SimpleNamespace(import_module=load))
    cost = measuring.answer("module:call", {}, 98.0)
    assert (cost.outcome, cost.start_seconds, cost.seconds, cost.cpu_seconds) == (DONE, 9.0, 3.0, 1.5)


def test_a_function_may_speak_for_itself():
    cost = measure("tests.helpers.measured_calls:speak", {}, 600)
    assert (cost.seconds, cost.cpu_seconds) == (12.5, 7.0)


@pytest.mark.parametrize(
    ("function", "limit", "outcome"),
    [
        ("refuse", 600, "failed: ValueError: not this one"),
        ("hold", 1.5, "stopped: time limit of 1.5 s"),
        ("die", 600, "ended: by the system, exit code -9"),
    ],
)
def test_why_there_is_no_number_is_said(function, limit, outcome):
    arguments = {"megabytes": 0, "seconds": 300} if function == "hold" else {}
    cost = measure(f"tests.helpers.measured_calls:{function}", arguments, limit)
    assert cost.outcome == outcome and np.isnan(cost.seconds)


def sizes():
    """Two stages with known exponents, of which one is stopped at the largest size."""
    rows = []
    for target in NODES:
        nodes = target + 7
        seconds = {"mesh": (1 + nodes / 1e4, "job"), "solve": (0.1 + (nodes / 1e4) ** 1.5, "plan")}
        for stage, (value, unit) in seconds.items():
            row = {"stage": stage, "unit": unit, "target": target, "nodes": nodes, "seconds": value}
            row |= {"cpu_seconds": value, "start_seconds": 2.0, "memory": 300 + nodes / 50, "written": 1.0}
            row |= {"outcome": DONE}
            if stage == "solve" and target == 50000:
                row |= dict.fromkeys(("seconds", "cpu_seconds", "start_seconds", "memory", "written"), np.nan)
                row |= {"outcome": "stopped: time limit of 9 s"}
            rows.append(row)
    rows.append(rows[-2] | {"stage": "pretrain net", "unit": "step", "target": 6000, "memory": 500.0})
    return pd.DataFrame(rows)


CASES = ["P1", "P2", "P1_b", "P3", "P4"]


@pytest.fixture
def benchmarks(tmp_path):
    """Five patients, one of them with a name that begins with another's; two folds of one method."""
    folder = tmp_path / "benchmarks"
    for number, case in enumerate(CASES):
        benchmark(folder / f"tetrahedralize/{case}.tsv", 10 + number, 9, 400 + number)
        benchmark(folder / f"make_lift/{case}_elastic.tsv", 2, 2, 900)
    for fold in "12":
        benchmark(folder / f"pretrain/{fold}_net.tsv", 100, 90, 590)
        benchmark(folder / f"finetune/{fold}_net.tsv", 20, 20, 500)
        benchmark(folder / f"evaluate/folds/{fold}_net.tsv", 5, 5, 500)
        benchmark(folder / f"evaluate/folds/{fold}_other.tsv", 500, 5, 500)
    return folder


def test_jobs_of_a_patient_are_added_up(benchmarks):
    runs = patient_runs(benchmarks, CASES)
    assert runs.groupby("stage")["case"].agg(list).to_dict() == {"tetrahedralize": CASES, "make_lift elastic": CASES}
    sums = patients(runs, [2, 4, 9]).set_index(["stage", "patients"])
    assert list(sums.index) == [(s, n) for s in ("tetrahedralize", "make_lift elastic") for n in (2, 4)]
    assert sums.loc[("tetrahedralize", 4)].tolist() == [46, 11.5, pytest.approx(1.2909944), 13, 403]
    assert sums.loc[("make_lift elastic", 2), "seconds"] == 4


def test_jobs_of_rules_that_serve_others_too_are_found_and_the_others_left_out(tmp_path):
    """A rule's files lie below the home of its patients: those of the study count, no new patient, no further mesh."""
    places = ("label_interfaces/cases/A", "label_interfaces/cases/A/lips", "virtual_patient/virtual/A")
    others = ("label_interfaces/patients/A", "label_interfaces/cases/A/nodes_900", "virtual_patient/virtual_chin/A")
    for place in (*places, *others):
        benchmark(tmp_path / f"{place}.tsv", 1.0, 1.0, 100)
    runs = patient_runs(tmp_path, ["A"])
    assert runs["stage"].tolist() == ["virtual_patient", "label_interfaces", "label_interfaces lips"]


def test_tables_hold_sizes_exponents_failures_and_paragraphs(benchmarks, tmp_path):
    paths = {name: tmp_path / f"{name}.csv" for name in ("scaling", "patients", "exponents", "sizes")}
    cohort = patients(patient_runs(benchmarks, CASES), [1, 2, 4])
    write(table(sizes(), cohort, "test clinic", ["A paragraph."]), paths["scaling"])
    sums = {"benchmarks": benchmarks, "cases": CASES, "counts": [1, 2, 4], "cohort": "test clinic"}
    make(paths["patients"], "tables.scaling_patients", **sums)
    write_csv(sizes(), paths["sizes"], SCALING)
    make(paths["exponents"], "tables.scaling_exponents", sizes=[paths["sizes"]], **sums)
    fits = read_table(paths["exponents"], EXPONENTS).set_index(["stage", "against", "quantity"])
    assert fits.loc[("mesh", "nodes", "seconds"), "exponent"] == pytest.approx(1, abs=1e-3)
    solve = fits.loc[("solve", "nodes", "seconds")]
    assert solve["exponent"] == pytest.approx(1.5, abs=1e-3) and solve["points"] == 5 and solve["largest"] == 25007
    assert fits.loc[("make_lift elastic", "patients", "seconds"), "exponent"] == pytest.approx(1, abs=1e-6)
    assert len(read_table(paths["scaling"], SCALING)) == 13 and len(read_table(paths["patients"], PATIENTS)) == 6
    text = paths["scaling"].with_suffix(".md").read_text()
    assert "No number: solve at 50,000 nodes: stopped: time limit of 9 s." in text
    solved = next(line for line in text.splitlines() if line.startswith("| solve"))
    assert "| stopped | 0.1000 | 1.50" in solved and solved.count("|") == 12
    assert text.count("test clinic") == 3 and text.endswith("A paragraph.\n") and "shared the machine" not in text
    assert all(paths["scaling"].with_suffix(suffix).exists() for suffix in (".tex", ".html"))


def test_a_machine_that_was_not_alone_is_said(benchmarks, tmp_path):
    slowed = sizes()
    slowed.loc[slowed["stage"] == "mesh", "seconds"] *= (NODES / 1500) ** 0.4
    sums = patients(patient_runs(benchmarks, CASES), [1, 2])
    write(table(slowed, sums, "test clinic"), tmp_path / "scaling.csv")
    fitted = exponents(slowed, sums).set_index(["stage", "quantity"])["exponent"]
    assert fitted["mesh", "cpu_seconds"] == pytest.approx(1, abs=1e-3) and fitted["mesh", "seconds"] > 1.1
    text = (tmp_path / "scaling.md").read_text()
    assert "in 5 of 12 measurements the processor worked less than 80% of the seconds, 25% at least" in text


def test_a_study_without_benchmarks_is_refused(tmp_path):
    with pytest.raises(InputError, match="benchmark files.*no row"):
        patients(patient_runs(tmp_path, CASES), [2])


def test_a_large_cohort_is_arithmetic(benchmarks):
    held_out = {"1": CASES[:3], "2": CASES[3:]}
    measured = Measured(benchmarks, CASES, held_out, {"1": 2, "2": 3}, ["net"], sizes(), 5000, 60.0)
    text = "\n".join(paragraphs(measured, 1000, "test clinic"))
    assert "test clinic, n = 5, 5,000 nodes, 2 folds" in text and "virtual patient" not in text
    assert "take 14 s of one core: 4 core hours in all" in text  # 12 + 2 s
    assert "holds 900 MB (make_lift elastic); its files are 60 MB, those of all 60 GB" in text
    assert "Jobs: 2 per patient, 2,000 in all, of 7.0 s in the mean, of which 2.0 s" in text
    assert "2 min for net" in text and "each of 500 training patients" in text
    # 500 patients instead of 2.5; 590 MB less 500 with one patient, over one further patient.
    assert "would take 6.67 h" in text and "90 MB each for net" in text and "45 GB" in text
    assert "at most 2.1 s for each (evaluate of net), 17.4 min for the 500 patients of a fold" in text


def test_the_picture_is_drawn_in_every_format(tmp_path):
    files = [tmp_path / "scaling.png", tmp_path / "scaling.svg"]
    draw(sizes(), files)
    assert files[0].stat().st_size > 20_000 and "<svg" in files[1].read_text()[:400]
    said = texts(files[1])
    assert "Train net a step: growth unclear, up to 0.5 GB" in said and "solve a plan: $n^{1.5" in said
    solve, mesh = (0.1 + 2.5007**1.5) / (0.1 + 0.1507**1.5), 3.5007 / 1.1507
    assert f"From 1,500 to 25,000 nodes “solve” takes {solve:.3g} times as long, “mesh” {mesh:.2g} times" in said
    assert size_growths(sizes())["solve", "nodes", "memory"].points == 5
    assert megabytes(tmp_path) == pytest.approx(sum(file.stat().st_size for file in files) / 1e6)
