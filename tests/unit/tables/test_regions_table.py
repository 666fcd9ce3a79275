"""Errors by place: means, tests per place, and how the twins show them."""

import numpy as np
import pandas as pd
import pytest

from pinnochio.columns import read_table
from pinnochio.metrics.case_columns import CASES
from pinnochio.metrics.region_errors import LANDMARKS, SHOWN
from pinnochio.statistics.wilcoxon import holm, wilcoxon
from pinnochio.tables import landmarks, regions
from pinnochio.tables.places import PLACES, Place, summarise, table
from tests.helpers.rows import row
from tests.helpers.tables import write

PATIENTS = 8
METHODS = ["surface", "solid", "pinnochio"]


@pytest.fixture
def cases():
    """Errors of 1 mm at every place, growing by patient; one method is worse at the nose, one predicts no volume."""
    rows = []
    for i in range(PATIENTS):
        for method in METHODS:
            errors = {place.error: 1 + 0.1 * i for place in places_of(regions, landmarks)}
            errors |= {f"bias_{name}": -0.5 for name in SHOWN}
            if method == "solid":
                errors["region_nose"] += 0.01 * (i + 1)
                errors["bias_chin"] = 0.25
                errors["landmark_menton"] -= 0.01 * (i + 1)
            if method == "surface":
                errors["volume_error_mean"] = errors["volume_error_p95"] = np.nan
            rows.append(row(f"V{i}", method, 1.0, **errors))
    return pd.DataFrame(rows)


def places_of(*modules) -> list[Place]:
    return [place for module in modules for group in module.GROUPS for place in group.places]


def summarised(cases, module, reference="pinnochio"):
    return summarise(cases, places_of(module), reference, METHODS, 3).set_index(["place", "method"])


def test_every_place_is_a_column_of_cases():
    names = {column.name for column in CASES}
    for place in places_of(regions, landmarks):
        assert {place.error, place.bias or place.error} <= names
    assert [place.name for place in places_of(regions)] == list(SHOWN)
    whole = ["skin", "skin_p95", "volume", "volume_p95"]
    assert [place.name for place in places_of(landmarks)] == [*LANDMARKS, *whole]


def test_a_region_is_tested_by_itself(cases):
    summary = summarised(cases, regions)
    worse = summary.loc[("nose", "solid")]
    assert worse["mean"] == pytest.approx(1.35 + 0.045) and worse["n"] == worse["pairs"] == 8
    assert worse["sd"] == pytest.approx(np.std(1.01 + 0.11 * np.arange(8), ddof=1))
    assert worse["difference"] == pytest.approx(0.045) and worse["low"] < 0.045 < worse["high"]
    assert worse["p"] == wilcoxon(np.arange(1, 9))[0] == 2 / 256 and worse["test"] == "exact"
    # Holm within the region: the other method's differences there are all zero, so that one is tested alone.
    assert worse["p_holm"] == pytest.approx(2 / 256)
    assert summary.loc[("nose", "surface"), "test"] == "all differences are zero: not tested"
    assert summary.loc[("chin", "solid"), ["mean", "bias"]].tolist() == [pytest.approx(1.35), pytest.approx(0.25)]
    assert summary.loc[("chin", "pinnochio"), "test"] == "reference" and summary.loc[("chin", "pinnochio"), "reference"]


def test_holm_counts_the_methods_of_one_place(cases):
    cases.loc[cases["method"] == "surface", "region_nose"] -= 0.02 * np.arange(1, 9)
    summary = summarised(cases, regions).loc["nose"]
    np.testing.assert_allclose(summary["p_holm"], holm(summary["p"]))
    assert summary.loc["solid", "p_holm"] == pytest.approx(4 / 256)


def test_a_method_without_a_volume_is_blank_there_and_tested_elsewhere(cases, tmp_path):
    summary = summarised(cases, landmarks)
    assert summary.loc[("volume", "surface"), "n"] == 0 and np.isnan(summary.loc[("volume", "surface"), "mean"])
    assert summary.loc[("volume", "surface"), "test"] == "no common patient: not tested"
    assert summary.loc[("volume", "solid"), "pairs"] == summary.loc[("menton", "surface"), "pairs"] == 8
    write(table(summary.reset_index(), landmarks.GROUPS, "test clinic"), tmp_path / "landmarks.csv")
    first, _, title, second, _ = (tmp_path / "landmarks.md").read_text().strip().split("\n\n")
    assert title == "**Skin and volume**"
    assert all(words in first for words in ("| menton |", "labrale inferius", "**1.3050 ± 0.2205\\***"))
    assert "| Method | skin | skin p95 | volume | volume p95 |" in second
    assert next(line for line in second.splitlines() if line.startswith("| surface")).endswith("|  |  |")


def test_the_twins_have_a_row_per_method_and_the_signed_error_below(cases, tmp_path):
    frame = summarised(cases, regions).reset_index()
    write(table(frame, regions.GROUPS, "test clinic"), tmp_path / "regions.csv")
    back = read_table(tmp_path / "regions.csv", PLACES)
    assert len(back) == len(METHODS) * len(SHOWN)
    for suffix in ("md", "tex", "html"):
        text = (tmp_path / f"regions.{suffix}").read_text()
        assert "test clinic" in text and "n = 8" in text and "+0.2500" in text and "-0.5000" in text
    text = (tmp_path / "regions.md").read_text()
    assert "1.3950 ± 0.2694\\*" in text and text.count("\\*") == 1
    assert "**1.3500 ± 0.2449**" in text


def test_nothing_is_tested_without_a_reference_and_nothing_lost_without_a_face(cases, tmp_path):
    cases[[f"{kind}_{name}" for name in SHOWN for kind in ("region", "bias")]] = np.nan
    summary = summarised(cases, regions, None)
    assert (summary["test"] == "no reference: not tested").all() and not summary["reference"].any()
    write(table(summary.reset_index(), regions.GROUPS, "test clinic"), tmp_path / "regions.csv")
    assert "n = 0" in (tmp_path / "regions.md").read_text()
