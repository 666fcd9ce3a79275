"""The quick study, end to end: what it leaves, that it settles, reruns by fold and repeats itself."""

import hashlib
import json
import re
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from tests.helpers.study import jobs, made_tables, without_timings

PATIENTS = 4
LEARNED = ["pinnochio_plus"]
SKIN_ALONE = ["ratio", "floor_scan"]
METHODS = ["no_change", "elastic", "fem_sliding", "oracle_learner", *SKIN_ALONE, *LEARNED]  # every method: tests/stages
PLANNED = LEARNED
VOLUME = re.compile("jacobian|inverted|volume|eqres|load_rel|moving_error|sliding_error")  # columns that a skin has not
RAW = ["raw_min_jacobian", "raw_inverted", "raw_eqres_paper", "raw_eqres_rel"]
GUARD = [*RAW, "repaired", "damping", "interface_error"]  # of networks alone


def tables(folder: Path) -> tuple[pd.DataFrame, pd.DataFrame]:
    return pd.read_csv(folder / "tables/cases.csv"), pd.read_csv(folder / "tables/accuracy.csv")


def contents(folder: Path) -> dict[str, str]:
    """Content hash of every result, log and benchmark files aside."""
    return {
        path.relative_to(folder).as_posix(): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in sorted(folder.rglob("*"))
        if path.is_file() and path.relative_to(folder).parts[0] not in ("logs", "benchmarks")
    }


def test_tables_have_one_row_per_case_and_method(studied):
    results = studied.folder / "results/quick"
    cases, accuracy = tables(results)
    assert sorted(accuracy["method"]) == sorted(METHODS)
    assert len(cases) == PATIENTS * len(METHODS) and not cases.duplicated(["case", "method"]).any()
    measured = cases.select_dtypes("number").drop(columns=GUARD)
    skin, volume = cases["method"].isin(SKIN_ALONE), [name for name in measured if VOLUME.search(name)]
    times = ["seconds", "setup_seconds"]
    assert np.isfinite(measured.loc[~skin].drop(columns=times)).all(None)
    assert measured.loc[skin, volume].isna().all(None)
    assert np.isfinite(measured.loc[skin].drop(columns=[*volume, *times])).all(None)
    timed = ~cases["method"].isin(["floor_scan", "oracle_learner"])
    assert np.isfinite(cases.loc[timed, times]).all(None) and cases.loc[~timed, times].isna().all(None)
    for name in ("target_samples", "skin_samples"):
        assert (cases.groupby("case")[name].nunique() == 1).all() and (cases[name] > 3000).all()
    learned = cases["method"].isin(LEARNED)
    assert np.isfinite(cases.loc[learned, GUARD]).all(None) and cases.loc[~learned, GUARD].isna().all(None)
    assert cases["converged"].all()
    regions, landmarks = (pd.read_csv(results / f"tables/{name}.csv") for name in ("regions", "landmarks"))
    assert len(regions) == 7 * len(METHODS) and len(landmarks) == 13 * len(METHODS)
    assert (regions["n"] == PATIENTS).all()
    blank = landmarks["method"].isin(SKIN_ALONE) & landmarks["place"].str.startswith("volume")
    assert (landmarks.loc[~blank, "n"] == PATIENTS).all() and (landmarks.loc[blank, "n"] == 0).all()
    training = pd.read_csv(results / "tables/training.csv").set_index("method")
    assert list(training.index) == LEARNED
    assert (training[["pretraining_seconds", "finetuning_seconds", "parameters"]] > 0).all(None)
    planned = pd.read_csv(results / "tables/planned.csv")
    assert sorted(planned["method"]) == PLANNED and (planned["n"] == PATIENTS).all()
    stages = pd.read_csv(results / "tables/stages.csv").set_index("rule")
    assert stages.loc["pretrain", "jobs"] == 2 and stages.index[-1] == "all"
    for name in ("cases", "accuracy", "planned", "regions", "landmarks", "segments", "training", "stages"):
        for suffix in ("md", "tex", "html"):
            assert (results / f"tables/{name}.{suffix}").stat().st_size > 100


def test_what_is_too_small_to_mean_anything_is_not_shown(studied):
    """Six patients cannot tell methods apart: no p, no star, no table of tests; nor networks of forty steps."""
    tables = studied.folder / "results/quick/tables"
    text = (tables / "accuracy.md").read_text()
    assert "No p is shown" in text and "p vs reference" not in text and "\\*" not in text
    assert not (tables / "better.csv").exists() and not (tables / "ablation.csv").exists()


def test_rules_that_the_quick_study_leaves_out(studied):
    """What is fitted at once, what needs a mesh of the lips, what has the outcome's motion: one fold of each."""
    overlay = studied.folder / "further.yaml"
    further = ["pca_linear", "fem_rlse_mucosa", "oracle"]
    overlay.write_text(json.dumps({"methods": [*METHODS, *further]}))
    metrics = [f"results/quick/folds/1/{method}/metrics.csv" for method in further]
    made = jobs(studied.quick("further.yaml", "--", *metrics))
    assert made == {"gather": 1, "fit": 1, "predict_both_motions": 2, "predict_cases": 1}
    rows = [pd.read_csv(studied.folder / path) for path in metrics]
    assert all(len(table) == PATIENTS / 2 and table["converged"].all() and (table["cd"] > 0).all() for table in rows)
    sliding = pd.read_csv(studied.folder / "results/quick/folds/1/fem_sliding/metrics.csv")
    assert abs(rows[-1]["cd"].mean() - sliding["cd"].mean()) < 0.05  # the registered motion costs little


def test_provenance_names_what_made_the_results(studied):
    record = json.loads((studied.folder / "results/quick/provenance.json").read_text())
    assert record["config"]["virtual"]["patients"] == PATIENTS and record["packages"]["torch"].startswith("2.13.0")
    assert len(record["code"]) == 12 and record["machine"]["cores"] >= 1


def test_a_second_run_has_nothing_to_do(studied):
    assert "Nothing to be done" in studied.planned()


def test_a_method_that_is_added_is_trained_alone(studied):
    added = studied.folder / "added.yaml"
    added.write_text(json.dumps({"methods": [*METHODS, "mine"], "variants": {"mine": {"network": {"channels": 16}}}}))
    said = studied.planned("added.yaml")
    assert set(re.findall(r"(?:Pretrain|Adapt|Fit) (\w+)", said)) == {"mine"}
    made = jobs(said)
    assert {made.pop(rule) for rule in ("pretrain", "finetune")} == {2}
    assert made.pop("predict_both_motions") == 2
    assert made.keys() == {"tabulate", "provenance", "all"}
    compared = {"cases", "accuracy", "planned", "regions", "landmarks"}
    assert made_tables(said) == compared | {"training", "stages"}


def test_no_file_of_a_held_out_patient_reaches_training(studied):
    """Change every file of one held-out patient: its own fold must not train again, the other fold must."""
    results = studied.folder / "results/quick"
    cases, _ = tables(results)
    case, fold = cases.loc[0, ["case", "fold"]]
    other = {"1": "2", "2": "1"}[str(fold)]
    files = [path for key in ("cases", "virtual") for path in (results / key / case).rglob("*") if path.is_file()]
    before = {path: path.read_bytes() for path in files}
    try:
        for path in files:
            path.write_bytes(before[path] + b"\n")
        plan = studied.planned("--rerun-triggers", "mtime")
    finally:
        for path, content in before.items():
            path.write_bytes(content)
        studied.quick("--touch")
    for trained in ("Pretrain", "Adapt"):
        folds = set(re.findall(trained + r" pinnochio_plus .* fold (\d)", plan))
        assert other in folds and str(fold) not in folds, trained


def test_rerunning_one_fold_changes_that_fold_and_the_aggregates_alone(studied):
    results = studied.folder / "results/quick"
    before, times = contents(results), {p: p.stat().st_mtime_ns for p in results.rglob("*") if p.is_file()}
    old = tables(results)
    wanted = "results/quick/tables/accuracy.csv"
    studied.quick("--forcerun", "results/quick/folds/1/pinnochio_plus/network.pt", "--", wanted)
    after = contents(results)
    written = {
        path.relative_to(results).as_posix()
        for path, time in times.items()
        if path.stat().st_mtime_ns != time and path.relative_to(results).parts[0] not in ("logs", "benchmarks")
    }
    assert before.keys() == after.keys()
    assert {name for name in before if before[name] != after[name]} <= written
    assert {"folds/1/pinnochio_plus/network.pt", "tables/accuracy.csv"} <= written
    remade = ("folds/1/pinnochio_plus/", "planned/1/pinnochio_plus/")
    assert all(name.startswith((*remade, "tables/", "provenance")) for name in written), written
    assert before["folds/1/pinnochio_plus/network.pt"] == after["folds/1/pinnochio_plus/network.pt"]
    for one, two in zip(old, tables(results), strict=True):
        pd.testing.assert_frame_equal(without_timings(one), without_timings(two))
    studied.quick("--touch")  # the other tables would be the same


@pytest.mark.full
def test_two_runs_give_the_same_numbers(studied):
    """From the cohort on: a fold of finite elements and of a network; other networks: tests/stages."""
    folds = [f"folds/1/{method}/metrics.csv" for method in ("fem_sliding", "pinnochio_plus")]
    again = [f"results/again/{fold}" for fold in folds]
    studied.quick("--config", "pathvars={results: results/again}", "--", *again)
    for fold in folds:
        one, two = (pd.read_csv(studied.folder / f"results/{run}/{fold}") for run in ("quick", "again"))
        assert len(one) == 3
        pd.testing.assert_frame_equal(without_timings(one), without_timings(two))
