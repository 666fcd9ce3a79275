"""The learning curve: its folds hold the same patients out, its table compares the same patients, its picture."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from pinnochio.columns import read_table
from pinnochio.errors import InputError
from pinnochio.study.folds import of_fewer, some, whole_fold
from pinnochio.study.study import Study
from studies.learning.figure import draw
from studies.learning.inputs import Learning
from studies.learning.table import LEARNING, enough, summarise, table
from tests.helpers.rows import row
from tests.helpers.settings import CONFIG
from tests.helpers.tables import write

SIZES = (8, 16, 32)


def cases(method, gain, patients=12):
    """Patients whose errors lie `gain` mm, times one to two, below 1.2 to 1.4 mm."""
    base, part = np.linspace(1.2, 1.4, patients), np.linspace(1, 2, patients)
    values = base - gain * part
    return pd.DataFrame([row(f"V{i}", method, cd, skin_error_mean=cd + 0.1) for i, cd in enumerate(values)])


@pytest.fixture
def rows():
    parts = {("floor_scan", 0): cases("floor_scan", 0.5), ("fem_sliding", 0): cases("fem_sliding", 0)}
    parts |= {("learns", size): cases("learns", 0.01 * (size - 12)) for size in SIZES}
    return parts | {("never", size): cases("never", -0.1) for size in SIZES}


def test_fewer_training_patients_are_among_more_and_the_same_are_held_out():
    names = [f"V{i:02d}" for i in range(1, 33)]
    few, more = some(names, 8, 1, "1"), some(names, 16, 1, "1")
    assert len(few) == 8 and set(few) < set(more) < set(names) and few == sorted(few)
    assert some(names, 8, 1, "2") != few and some(names, 8, 2, "1") != few
    assert whole_fold(of_fewer("3", 16)) == ("3", 16) and whole_fold("3") == ("3", None)


def test_the_folds_of_the_curve_end_with_those_of_the_study():
    study = Study.of(CONFIG)
    folds, methods = study.folds, study.methods
    section = {"methods": ["pinnochio"], "patients": [128, 16, 8, 32], "folds": 2}
    curve = Learning(section, {fold: len(folds.training(fold)) for fold in folds.held_out}, methods.used)
    assert curve.folds == {8: ["1of8", "2of8"], 16: ["1of16", "2of16"], 32: ["1", "2"]}
    for fold in ("1of8", "1of16"):
        assert folds.kept_from(fold) == folds.held_out["1"] == folds.judged(fold)
        assert set(folds.training(fold)) < set(folds.training("1"))
    files = curve.metrics(None)
    assert files["untrained"][0] == "<results>/folds/1/floor_scan/metrics.csv" and len(files["untrained"]) == 4
    assert files["trained"][0] == "<results>/folds/1of8/pinnochio/metrics.csv" and len(files["trained"]) == 6
    with pytest.raises(InputError, match="fem_sliding.*add it to 'methods'"):
        replace(curve, methods=["no_change", "pinnochio"]).metrics(None)


def test_each_number_is_compared_over_the_same_patients(rows):
    frame = summarise(rows, 3)
    assert list(zip(frame["method"], frame["patients"], strict=True)) == list(rows)
    by_size = frame.set_index(["method", "patients"])
    assert by_size.loc[("learns", 8), "cd_difference"] == pytest.approx(0.06)
    assert by_size.loc[("learns", 32), "cd_difference"] == pytest.approx(-0.3)
    assert by_size.loc[("learns", 32), "explained"] == pytest.approx(0.4)
    assert by_size.loc[("floor_scan", 0), "explained"] == 1 and by_size.loc[("fem_sliding", 0), "explained"] == 0
    assert by_size["cd_difference"].isna().to_dict() == {key: key[1] == 0 for key in rows}
    for name in ("cd", "skin_error_mean"):
        low, mean, high = (by_size[f"{name}_{part}"] for part in ("low", "mean", "high"))
        assert (low <= mean).all() and (mean <= high).all() and (low < high).sum() > 4
    shuffled = {key: frame.sample(frac=1, random_state=1) for key, frame in rows.items()}
    assert summarise(shuffled)["cd_difference"].tolist() == pytest.approx(frame["cd_difference"].tolist(), nan_ok=True)


def test_it_is_said_from_how_many_patients_on_a_method_is_better(rows):
    said = enough(summarise(rows))
    words = "learns against fem_sliding by Chamfer distance: better from 16 training patients on, as far as measured."
    assert said[0] == words
    assert "with up to 32 training patients it is not told apart or worse" in said[2]
    rows["learns", 32] = cases("learns", -0.2)
    assert "not told apart or worse" in enough(summarise(rows))[0]


def test_without_a_known_truth_and_floor_the_chamfer_distance_is_left(rows, tmp_path):
    for key in list(rows):
        rows[key] = rows[key].assign(skin_error_mean=np.nan)
    del rows["floor_scan", 0]
    written = table(summarise(rows), "my cohort")
    assert written.blocks[0].headers == ["Method", "Training patients", "Chamfer distance [mm]"]
    assert len(written.paragraphs) == 2
    draw(written.frame, [tmp_path / "learning.png"])
    assert (tmp_path / "learning.png").stat().st_size > 10_000


def test_files_are_written_and_drawn(rows, tmp_path):
    path = tmp_path / "learning.csv"
    write(table(summarise(rows), "virtual cohort"), path)
    frame = read_table(path, LEARNING)
    draw(frame, [tmp_path / "one.png", tmp_path / "one.svg"])
    draw(frame, [tmp_path / "two.png"])
    assert (tmp_path / "one.png").read_bytes() == (tmp_path / "two.png").read_bytes()
    assert "virtual cohort, n = 12 held-out patients" in path.with_suffix(".md").read_text()
