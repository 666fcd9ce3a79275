"""The table of corrections and its picture: means, tests against no correction, files."""

import numpy as np
import pandas as pd
import pytest

from pinnochio.columns import read_table
from pinnochio.errors import InputError
from pinnochio.statistics.wilcoxon import holm, wilcoxon
from studies.corrections.figure import draw
from studies.corrections.table import CORRECTIONS, summarise, table
from tests.helpers.rows import row
from tests.helpers.tables import texts, write

COUNTS = (0, 1, 5)


def cases(method, count, patients=8):
    """Corrections take 0.01 mm times the patient's number off, and three decimals of the residual."""
    base = np.linspace(1, 2, patients)
    shift = 0.01 * np.arange(1, patients + 1) * (count > 0)
    more = [{"eqres_rel": 10.0 ** (-count - i % 2), "seconds": 0.1 + 0.08 * count} for i in range(patients)]
    return pd.DataFrame(
        [row(f"V{i}", method, c - s, **m) for i, (c, s, m) in enumerate(zip(base, shift, more, strict=True))]
    )


@pytest.fixture
def rows():
    return {(method, count): cases(method, count) for method in ("plain", "plus") for count in COUNTS}


def test_every_row_is_the_mean_of_its_patients_and_tested_against_no_correction(rows):
    frame = summarise(rows, 3)
    assert list(zip(frame["method"], frame["corrections"], strict=True)) == list(rows)
    for (_, summary), expected in zip(frame.iterrows(), rows.values(), strict=True):
        assert summary["n"] == 8 and summary["inverted"] == 16
        for name in ("cd", "pwr1", "eqres_rel", "seconds"):
            assert summary[f"{name}_mean"] == pytest.approx(expected[name].mean())
            assert summary[f"{name}_sd"] == pytest.approx(expected[name].std())
        assert summary["eqres_rel_max"] == pytest.approx(10.0 ** -summary["corrections"])
    start = frame[frame["corrections"] == 0]
    assert start[["pairs", "cd_difference", "p", "p_holm"]].isna().all(axis=None)
    tested = frame[frame["corrections"] > 0]
    p = wilcoxon(-np.arange(1, 9))[0]
    np.testing.assert_allclose(tested["cd_difference"], -0.045)
    np.testing.assert_allclose(tested["p"], p)
    np.testing.assert_allclose(tested["p_holm"], np.tile(holm([p, p]), 2))
    assert (tested["cd_low"] < -0.045).all() and (tested["cd_high"] > -0.045).all() and (tested["pairs"] == 8).all()


def test_the_comparison_is_by_patient_not_by_place(rows):
    rows["plain", 1] = rows["plain", 1].iloc[::-1]
    frame = summarise(rows).set_index(["method", "corrections"])
    assert frame.loc[("plain", 1), "p"] == frame.loc[("plus", 1), "p"]


def test_a_patient_without_scan_counts_but_is_not_compared(rows):
    for count in COUNTS:
        rows["plain", count].loc[2, "cd"] = np.nan
    frame = summarise(rows).set_index(["method", "corrections"])
    assert tuple(frame.loc[("plain", 5), ["n", "pairs"]]) == (8, 7)
    assert frame.loc[("plain", 5), "cd_mean"] == pytest.approx(rows["plain", 5]["cd"].mean())


def test_a_method_without_a_prediction_is_refused(rows):
    del rows["plus", 0]
    with pytest.raises(InputError, match="'plus' has no rows without correction"):
        summarise(rows)


def test_files_and_picture(rows, tmp_path):
    write(table(summarise(rows), "made-up cohort"), tmp_path / "corrections.csv")
    back = read_table(tmp_path / "corrections.csv", CORRECTIONS)
    assert len(back) == 6
    text = (tmp_path / "corrections.md").read_text()
    assert "made-up cohort, n = 8 patients" in text and "-0.0450 (p = 0.015625)" in text and "1.5000 ± " in text
    assert all((tmp_path / f"corrections.{suffix}").stat().st_size > 500 for suffix in ("tex", "html"))
    draw(back, [tmp_path / "corrections.png", tmp_path / "corrections.svg"])
    assert (tmp_path / "corrections.png").stat().st_size > 20_000
    assert "plus is nearer than no correction" in texts(tmp_path / "corrections.svg")


def test_the_picture_shows_the_paired_difference_to_sliding_finite_elements(rows, tmp_path):
    baseline = cases("fem_sliding", 0).assign(cd=lambda table: table["cd"] + 0.02)
    frame = summarise(rows, 0, baseline.iloc[::-1]).set_index(["method", "corrections"])
    np.testing.assert_allclose(frame["sliding_difference"], [-0.02, -0.065, -0.065] * 2)
    assert frame.loc[("plus", 5), "sliding_low"] < -0.065 < frame.loc[("plus", 5), "sliding_high"] < 0
    draw(frame.reset_index(), [tmp_path / "corrections.svg"])
    said = texts(tmp_path / "corrections.svg")
    assert "by 0.045 mm at most: plain is nearer than sliding FEM, plus is nearer than sliding FEM" in said
    frame.loc[("plus", 5), ["sliding_low", "sliding_high"]] = np.nan
    draw(frame.reset_index(), [tmp_path / "corrections.svg"])
    assert "nearer" not in texts(tmp_path / "corrections.svg")


def test_few_patients_are_said_to_be_few(tmp_path):
    frame = summarise({("plain", count): cases("plain", count, 2) for count in COUNTS})
    write(table(frame, "made-up cohort"), tmp_path / "corrections.csv")
    assert "n = 2 < 6: not tested" in (tmp_path / "corrections.md").read_text()
