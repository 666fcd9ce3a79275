"""The paper's values and claims beside ours."""

import numpy as np
import pandas as pd
import pytest

from pinnochio.columns import read_table
from pinnochio.tables import claims
from pinnochio.tables.accuracy import table
from pinnochio.tables.claims import ABSENT, CLAIMS, EQUAL, OPPOSITE, REPRODUCED, UNKNOWN
from pinnochio.tables.comparison import COMPARISON, summarise
from pinnochio.tables.published import OURS, TABLE_1, published_block
from tests.helpers.rows import row
from tests.helpers.tables import write

PAPER = {"acmt_pretrained": 2.19, "dgcfp_pretrained": 1.71, "fem_rlse": 1.30, "pinnochio": 1.12}


def cases(patients=8, **cd):
    """Patients whose CD grows by 0.1 mm from one to the next, and a little with the method's own CD."""
    rows = [
        row(f"V{i}", method, value * (1 + 0.01 * i) + 0.1 * i) for method, value in cd.items() for i in range(patients)
    ]
    return pd.DataFrame(rows)


def test_the_paper_orders_its_methods_as_it_prints_them():
    assert list(TABLE_1["method"]) == list(OURS) and TABLE_1["cd_mean"].is_monotonic_decreasing
    assert dict(zip(OURS.values(), TABLE_1["cd_mean"], strict=True)) == PAPER
    assert TABLE_1.set_index("method").loc["FEM-RLSE", ["pwr2_sd", "seconds"]].tolist() == [10.12, 12600]


@pytest.mark.parametrize("suffix", ["md", "tex", "html"])
def test_the_papers_values_stand_apart_in_the_twins_alone(tmp_path, suffix):
    summary = summarise(cases(pinnochio=1.0, dgcfp=0.9))
    write(table(summary, "virtual cohort", [published_block()]), tmp_path / "a.csv")
    text = (tmp_path / f"a.{suffix}").read_text()
    assert text.index("virtual cohort") < text.index("clinical cohort, Lee et al. 2026 (arXiv 2606.01572)")
    assert "12600" in text and "12.98" in text
    assert read_table(tmp_path / "a.csv", COMPARISON)["method"].tolist() == ["dgcfp", "pinnochio"]
    assert "12600" not in (tmp_path / "a.csv").read_text()


def made(folder, **methods):
    """Ten patients; each method's columns beside those that are the same for all."""
    rows = [
        row(f"V{i}", method, 1 + by.get("cd", 0.0) * (1 + 0.01 * i), **{k: v(i) for k, v in by.items() if k != "cd"})
        for method, by in methods.items()
        for i in range(10)
    ]
    write(claims.table(pd.DataFrame(rows), "virtual cohort", 0), folder / "claims.csv")
    return read_table(folder / "claims.csv", CLAIMS).set_index(["worse", "measure"])


def test_each_claim_has_the_papers_values_ours_and_a_verdict(tmp_path):
    def squares(base):
        return lambda i: base + i

    table = made(
        tmp_path,
        pinnochio={"raw_eqres_paper": squares(100.0)},
        pinnochio_unified={"cd": -0.2, "raw_eqres_paper": squares(110.5)},
        pinnochio_no_physics={"raw_eqres_paper": squares(400.25)},
        fem_rlse={"cd": 0.3},
        dgcfp_pretrained={"cd": 0.5},
        acmt_pretrained={},
    )
    assert len(table) == 3 * 4 + 2 * 4 and (table["better"] == "pinnochio").all()
    rlse = table.loc["fem_rlse", "cd"]
    assert (rlse["theirs_better"], rlse["theirs_worse"]) == (1.12, 1.30)
    assert rlse["difference"] == pytest.approx(-0.3 * 1.045, rel=1e-3) and rlse["pairs"] == 10
    assert rlse["low"] < rlse["difference"] < rlse["high"] < 0
    assert rlse["p"] == pytest.approx(2 / 2**10, rel=1e-4) and rlse["verdict"] == REPRODUCED
    assert rlse["p_holm"] == pytest.approx(12 * rlse["p"], rel=1e-4)  # twelve claims have a p
    assert table.loc["pinnochio_unified", "cd"]["verdict"] == OPPOSITE
    equal = table.loc["acmt_pretrained", "cd"]
    assert equal["verdict"] == EQUAL and table.loc["acmt_pretrained", "hd95"]["verdict"] == UNKNOWN
    assert np.isnan(equal["p"]) and "zero" in equal["test"]
    residual = table.loc["pinnochio_no_physics", "raw_eqres_paper"]
    assert (residual["theirs_better"], residual["theirs_worse"]) == (0.20, 1.73)
    assert residual["ours_worse"] == pytest.approx(404.75, abs=0.1) and residual["unit"] == "mN2"
    text = (tmp_path / "claims.md").read_text()
    assert "| PINNOCHIO before FEM-RLSE, lips in contact | cd | mm | 1.12 against 1.3 |" in text
    assert "virtual cohort" in text


def test_more_within_a_millimetre_is_better(tmp_path):
    table = made(tmp_path, pinnochio={"pwr1": lambda i: 70 + i}, acmt_pretrained={"pwr1": lambda i: 60 + 0.9 * i})
    assert table.loc["acmt_pretrained", "pwr1"]["difference"] > 0
    assert table.loc["acmt_pretrained", "pwr1"]["verdict"] == REPRODUCED


def test_a_claim_about_a_method_that_the_study_lacks_says_so(tmp_path):
    table = made(tmp_path, pinnochio={}, acmt_pretrained={"cd": 0.1})
    absent = table.loc["dgcfp_pretrained", "cd"]
    assert absent["verdict"] == ABSENT and absent["test"] == "dgcfp_pretrained not in the study"
    assert np.isnan(absent["p"])
    assert set(made(tmp_path, pinnochio={})["verdict"]) == {ABSENT}
