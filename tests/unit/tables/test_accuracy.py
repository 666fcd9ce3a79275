"""Tests over patients and tables: hand-worked numbers, SciPy as the oracle, files that agree."""

import html
import re

import numpy as np
import pandas as pd
import pytest
from scipy import stats

from pinnochio.columns import check, read_table, write_csv, write_rows
from pinnochio.errors import InputError
from pinnochio.metrics.case_columns import CASES
from pinnochio.statistics.wilcoxon import bootstrap_interval, compare, holm, wilcoxon
from pinnochio.tables.accuracy import table
from pinnochio.tables.cases import same_samples
from pinnochio.tables.comparison import COMPARISON, summarise
from tests.helpers.rows import row
from tests.helpers.tables import make, write


def test_the_exact_p_by_hand():
    # Six positive differences: both tails of 2^-6. Ranks 1..6 with rank 1 negative: W- = 1, two of 64 signs as low.
    assert wilcoxon([1, 2, 3, 4, 5, 6]) == (pytest.approx(2 / 64), "exact")
    assert wilcoxon([-1, 2, 3, 4, 5, 6])[0] == pytest.approx(4 / 64)
    assert wilcoxon([-1, -2, 3, 4, 5, 6])[0] == pytest.approx(10 / 64)  # W- = 3: {}, 1, 2, 3, 12
    assert wilcoxon([-1, 1, -2, 2, -3, 3])[0] == 1


@pytest.mark.parametrize("n", [6, 9, 20, 40])
def test_without_ties_the_test_is_scipys(n):
    difference = np.random.default_rng(n).normal(0.3, 1, n)
    assert wilcoxon(difference)[0] == pytest.approx(stats.wilcoxon(difference, method="exact").pvalue, rel=1e-9)


def test_ties_are_counted_over_all_signs_and_said():
    difference = np.array([0.1, 0.1, -0.1, 0.2, 0.2, 0.3, 0.4])
    signs = np.array(np.meshgrid(*[(-1, 1)] * 7)).reshape(7, -1).T
    ranks = stats.rankdata(np.abs(difference))
    null = (ranks * (signs > 0)).sum(axis=1)
    observed = ranks[difference > 0].sum()
    expected = min(1, 2 * min((null <= observed).mean(), (null >= observed).mean()))
    p, statement = wilcoxon(difference)
    assert p == pytest.approx(expected) and statement == "exact; ties share ranks"
    # Equal in decimals though not in the last bit.
    assert wilcoxon([0.3 - 0.2, 0.1, 0.2 - 0.1, 0.5, 0.6, 0.7])[1] == "exact; ties share ranks"


def test_ties_of_many_pairs_take_the_normal_approximation_which_does_not_overstate():
    difference = np.concatenate([np.arange(1, 14), [13, -1, -2, -14.0]])
    ranks = stats.rankdata(np.abs(difference))
    signs = (np.arange(2**17)[:, None] >> np.arange(17)) & 1
    null, observed = signs @ ranks, ranks[difference < 0].sum()
    exact = 2 * (null <= observed).mean()
    mean, variance = ranks.sum() / 2, (ranks**2).sum() / 4
    by_hand = 2 * stats.norm.sf((mean - observed - 0.5) / np.sqrt(variance))
    p, statement = wilcoxon(difference)
    assert p == pytest.approx(by_hand) and statement == "normal approximation: ties"
    assert exact < p < 1.5 * exact
    assert wilcoxon(np.append(difference, 0))[1] == "normal approximation: ties; 1 zero difference dropped"


def test_zeros_and_small_n_give_a_statement_instead_of_a_p():
    assert wilcoxon([0, 0, 1, 2, 3, 4, 5, 6]) == (pytest.approx(2 / 64), "exact; 2 zero differences dropped")
    for difference, words in (
        ([1, 2, 3, 4, 5], "n = 5 < 6"),
        ([0] * 10, "all differences are zero"),
        ([0, 0, 0, 1, 2, 3, 4, 5], "only 5 differences"),
    ):
        p, statement = wilcoxon(difference)
        assert np.isnan(p) and words in statement and "not tested" in statement
    assert compare([], [], 0).statement == "no common patient: not tested"


def test_holm_by_hand():
    np.testing.assert_allclose(holm([0.01, 0.04, 0.03, 0.005]), [0.03, 0.06, 0.06, 0.02])
    np.testing.assert_allclose(holm([0.6, np.nan, 0.02]), [0.6, np.nan, 0.04])
    np.testing.assert_allclose(holm([0.9, 0.8]), [1, 1])


def test_the_bootstrap_interval_is_seeded_and_as_wide_as_the_mean_is_uncertain():
    difference = np.random.default_rng(0).normal(2, 1, 100)
    low, high = bootstrap_interval(difference, 7)
    assert (low, high) == bootstrap_interval(difference, 7) != bootstrap_interval(difference, 8)
    half = 1.96 * difference.std() / 10
    assert low == pytest.approx(difference.mean() - half, abs=0.03)
    assert high == pytest.approx(difference.mean() + half, abs=0.03)
    assert np.isnan(bootstrap_interval([1.0], 0)).all()
    comparison = compare(difference, np.zeros(100), 7)
    assert (comparison.low, comparison.high, comparison.n) == (low, high, 100)
    assert comparison.median == pytest.approx(np.median(difference))


@pytest.fixture
def cases():
    base = np.linspace(1, 2, 8)
    rows = [row(f"V{i}", "pinnochio", c) for i, c in enumerate(base)]
    rows += [row(f"V{i}", "worse", c + 0.1 * (i + 1)) for i, c in enumerate(base)]
    rows += [row(f"V{i}", "fem_like", c + (-1) ** i * 0.01 * (i + 1)) for i, c in enumerate(base)]
    return pd.DataFrame(rows)


def test_the_summary_has_the_mean_spread_and_test_of_every_method(cases):
    summary = summarise(cases, "pinnochio", ["worse", "fem_like", "pinnochio"]).set_index("method")
    assert list(summary.index) == ["worse", "fem_like", "pinnochio"]
    base = np.linspace(1, 2, 8)
    assert summary.loc["pinnochio", "cd_mean"] == pytest.approx(1.5)
    assert summary.loc["pinnochio", "cd_sd"] == pytest.approx(base.std(ddof=1))
    assert summary.loc["worse", "cd_mean_difference"] == pytest.approx(0.45)
    assert summary.loc["worse", "cd_median_difference"] == pytest.approx(0.45)
    assert summary.loc["worse", "p"] == pytest.approx(2 / 256)
    assert summary.loc["worse", "p_holm"] == pytest.approx(4 / 256)
    assert summary.loc["fem_like", "p_holm"] == pytest.approx(summary.loc["fem_like", "p"])
    assert summary.loc["fem_like", "p"] > 0.5
    assert np.isnan(summary.loc["pinnochio", "p"]) and summary.loc["pinnochio", "test"] == "reference"
    assert (summary["n"] == 8).all() and (summary["inverted"] == 16).all() and summary.loc["worse", "cd_low"] > 0


def test_failed_patients_are_counted_and_left_out_of_the_pairs(cases):
    cases.loc[(cases["method"] == "worse") & (cases["case"] == "V3"), ["cd", "converged"]] = [np.nan, False]
    summary = summarise(cases).set_index("method")
    assert summary.loc["worse", ["n", "failed", "pairs"]].tolist() == [7, 1, 7]
    assert summary.loc["fem_like", ["n", "failed", "pairs"]].tolist() == [8, 0, 8]


def test_nothing_is_tested_without_a_reference(cases, tmp_path):
    summary = summarise(cases, None, ["worse", "fem_like"]).set_index("method")
    assert (summary["test"] == "no reference: not tested").all() and not summary["reference"].any()
    assert summary[["p", "p_holm", "pairs"]].isna().all(None) and summary.loc["worse", "cd_mean"] == pytest.approx(1.95)
    write(table(summary.reset_index(), "virtual cohort"), tmp_path / "accuracy.csv")


def test_a_method_that_nobody_timed_has_no_time_and_is_not_the_fastest(cases, tmp_path):
    cases.loc[cases["method"] == "worse", ["seconds", "setup_seconds"]] = np.nan
    summary = summarise(cases).set_index("method")
    assert np.isnan(summary.loc["worse", "seconds_mean"]) and summary.loc["fem_like", "seconds_mean"] == 1
    write(table(summary.reset_index(), "virtual cohort"), tmp_path / "accuracy.csv")
    line = next(text for text in (tmp_path / "accuracy.md").read_text().splitlines() if text.startswith("| worse"))
    assert line.split("|")[8].strip() == ""


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda f: f.drop(columns="cd"), "'cd' is missing"),
        (lambda f: f.assign(extra=1), "'extra' is not in the schema"),
        (lambda f: f.assign(cd="far"), "'cd' holds something that is not a number"),
        (lambda f: f.assign(nodes=4.5), "'nodes' holds something that is not a whole number"),
        (lambda f: f.assign(converged=2), "'converged' holds something that is not True or False"),
        (lambda f: f.assign(nodes=np.nan), "'nodes' has an empty cell"),
        (lambda f: f.assign(method=""), "'method' has an empty cell"),
        (lambda f: f.iloc[:0], "no row"),
    ],
)
def test_a_table_that_breaks_its_schema_is_refused_on_write_and_on_read(cases, tmp_path, change, words):
    broken = change(check(cases, CASES))
    with pytest.raises(InputError, match=words):
        write_csv(broken, tmp_path / "cases.csv", CASES)
    with pytest.raises(InputError, match=words):
        write_rows(broken.to_dict("records"), tmp_path / "cases.csv", CASES)
    assert not (tmp_path / "cases.csv").exists()
    broken.to_csv(tmp_path / "cases.csv", index=False)
    with pytest.raises(InputError, match=rf"cases\.csv.*{words}.*Remedy"):
        read_table(tmp_path / "cases.csv", CASES)


def test_rows_are_written_as_their_frame_is(cases, tmp_path):
    rows = cases.to_dict("records")
    write_rows([dict(reversed(row.items())) for row in rows], tmp_path / "rows.csv", CASES)
    write_csv(cases, tmp_path / "frame.csv", CASES)
    assert (tmp_path / "rows.csv").read_bytes() == (tmp_path / "frame.csv").read_bytes()


def test_a_table_in_another_order_is_put_in_order_on_write_and_refused_on_read(cases, tmp_path):
    turned = cases[cases.columns[::-1]]
    write_csv(turned, tmp_path / "cases.csv", CASES)
    assert list(read_table(tmp_path / "cases.csv", CASES)) == [column.name for column in CASES]
    turned.to_csv(tmp_path / "cases.csv", index=False)
    with pytest.raises(InputError, match=r"cases\.csv.*is out of place"):
        read_table(tmp_path / "cases.csv", CASES)


def test_summaries_of_doubled_or_absent_rows_are_refused(cases):
    with pytest.raises(InputError, match="twice"):
        summarise(pd.concat([cases, cases]))
    with pytest.raises(InputError, match="'magic' has no row"):
        summarise(cases, "magic")


def test_a_written_table_reads_back_sorted_and_its_bytes_do_not_depend_on_the_order(cases, tmp_path):
    files = {"metrics": [tmp_path / "metrics.csv"], "cohort": "virtual cohort"}
    for name, rows in (("a", cases), ("b", cases.sample(frac=1, random_state=1))):
        write_csv(rows, tmp_path / "metrics.csv", CASES)
        make(tmp_path / f"{name}.csv", "pinnochio.tables.cases", **files)
    for suffix in ("csv", "md", "tex", "html"):
        assert (tmp_path / f"a.{suffix}").read_bytes() == (tmp_path / f"b.{suffix}").read_bytes()
    back = read_table(tmp_path / "a.csv", CASES)
    pd.testing.assert_frame_equal(back, check(cases.sort_values(["case", "method"]), CASES), atol=1e-4, rtol=1e-4)
    assert back["converged"].dtype == bool and back["nodes"].dtype.kind == "i"
    assert "virtual cohort, 8 patients" in (tmp_path / "a.md").read_text()


def numbers(text):
    return re.findall(r"\d+\.\d+", re.sub(r"<(style|title)>.*?</\1>", "", text, flags=re.S))


def test_the_twins_hold_the_numbers_of_the_csv(cases, tmp_path):
    frame = summarise(cases, methods=["worse", "fem_like", "pinnochio"])
    write(table(frame, "Test clinic"), tmp_path / "accuracy.csv")
    stored = pd.read_csv(tmp_path / "accuracy.csv", dtype=str)
    texts = {s: (tmp_path / f"accuracy.{s}").read_text() for s in ("md", "tex", "html")}
    wanted = [value for name in ("cd", "hd95", "pwr1", "pwr2") for value in stored[f"{name}_mean"]]
    for suffix, text in texts.items():
        assert "Test clinic" in text and "n = 8" in text
        printed = numbers(text)
        assert not [value for value in wanted if value not in printed], suffix
        assert sorted(printed) == sorted(numbers(texts["md"])), suffix
    star = f"{stored['cd_mean'][0]} ± {stored['cd_sd'][0]}*"
    assert star.replace("*", "\\*") in texts["md"] and star.replace("±", r"$\pm$") in texts["tex"]
    assert star in html.unescape(texts["html"]) and texts["html"].count("*</td>") == 1
    assert all("0.015625" in text for text in texts.values())
    best = next(line for line in texts["md"].splitlines() if line.startswith("| fem"))
    assert "**1.4950 ± " in best and texts["md"].count("**1.000**") == 3  # ties share the bold
    for suffix, mark in (("tex", r"\\textbf\{1\.4950 "), ("html", r"<b>1\.4950 ")):
        assert re.search(mark, texts[suffix])
    assert "fem\\_like" in texts["tex"] and "PWR@1 \\%" in texts["tex"]
    back = read_table(tmp_path / "accuracy.csv", COMPARISON)
    assert back["reference"].tolist() == [False, False, True]


@pytest.fixture
def bounded(cases):
    """Fixed distances to the floor: the reference half way from finite elements to it, one method worse than these."""
    base = np.linspace(1, 2, 8)
    rows = [row(f"V{i}", "fem_sliding", c + 0.4) for i, c in enumerate(base)]
    rows += [row(f"V{i}", "floor_scan", c - 0.4, seconds=np.nan, setup_seconds=np.nan) for i, c in enumerate(base)]
    return pd.concat([cases, pd.DataFrame(rows)])


def test_the_explained_share_is_nothing_of_finite_elements_and_all_of_the_floor(bounded, tmp_path):
    methods = ["fem_sliding", "pinnochio", "worse"]
    frame = summarise(bounded, "pinnochio", methods, 1, ["floor_scan"])
    by_method = frame.set_index("method")
    assert list(by_method.index) == [*methods, "floor_scan"] and by_method["bound"].tolist() == [False] * 3 + [True]
    assert by_method["explained"].to_dict() == pytest.approx(
        {"fem_sliding": 0, "pinnochio": 0.5, "worse": (0.4 - 0.45) / 0.8, "floor_scan": 1}
    )
    assert by_method.loc["pinnochio", ["explained_low", "explained_high"]].tolist() == pytest.approx([0.5, 0.5])
    floor = by_method.loc["floor_scan"]
    assert floor["test"] == "bound: not tested" and np.isnan(floor["p_holm"]) and floor["cd_mean"] == pytest.approx(1.1)
    without = summarise(bounded, "pinnochio", methods, 1).set_index("method")
    assert without["p_holm"].to_dict() == pytest.approx(by_method["p_holm"][:3].to_dict(), nan_ok=True)
    write(table(frame, "virtual cohort"), tmp_path / "accuracy.csv")
    above, below = (tmp_path / "accuracy.md").read_text().split("Bounds")
    assert "Noise of the scan:" in below and "true motion" not in below  # of the bounds that are there
    assert "| Noise of the scan |" not in above and "| Noise of the scan |" in below
    assert "**" not in below.split("\n\n")[1]
    assert "Explained" in above and "0.500 [0.500, 0.500]" in above


def test_without_a_floor_nothing_is_explained(cases, tmp_path):
    summary = summarise(cases)
    assert summary[["explained", "explained_low", "explained_high"]].isna().all(None)
    write(table(summary, "some clinic"), tmp_path / "accuracy.csv")
    assert "| Explained" not in (tmp_path / "accuracy.md").read_text()


def test_rows_that_were_judged_by_different_samples_are_refused(cases):
    same_samples(cases.assign(target_samples=100.0, skin_samples=90.0))
    numbers = np.where(cases["method"] == "worse", 99.0, 100.0)
    with pytest.raises(InputError, match="'V0'.*different target_samples"):
        same_samples(cases.assign(target_samples=numbers, skin_samples=90.0))
