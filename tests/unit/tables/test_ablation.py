"""The tables that set variants beside each other: whose numbers they hold and what they say of each."""

import numpy as np
import pandas as pd
import pytest

from pinnochio.columns import read_table
from pinnochio.overlays import changes
from pinnochio.tables import ablation
from pinnochio.tables.ablation import ABLATION
from studies.design import table as design
from studies.design.table import DESIGN
from tests.helpers.rows import row
from tests.helpers.tables import write

FULL = {
    "network": {"decomposition": True, "lift": "none"},
    "pretraining": {"weights": {"physics": 1, "data": 2}},
    "finetuning": {"weights": {"physics": 1, "data": 2}},
    "newton_corrections": 0,
}
SILENT = {"pretraining": {"weights": {"physics": 0, "data": 2}}, "finetuning": {"weights": {"physics": 0, "data": 2}}}
VARIANTS = {
    "unified": FULL | {"network": {"decomposition": False, "lift": "none"}},
    "no_physics": FULL | SILENT,
    "full": FULL,
}


def cases(**errors):
    """Eight patients; each method's error in mm beside that of the full model."""
    rows = [
        row(f"V{i}", method, 1 + 0.1 * i + error * (1 + 0.01 * i), raw_min_jacobian=0.5 - error)
        for method, error in errors.items()
        for i in range(8)
    ]
    return pd.DataFrame(rows)


def test_ablation_says_what_each_variant_lacks_and_tests_it_against_the_full_model(tmp_path):
    rows = cases(full=0.0, no_physics=0.2, unified=0.3)
    write(ablation.table(rows, VARIANTS, "virtual cohort", 0), tmp_path / "a.csv")
    table = read_table(tmp_path / "a.csv", ABLATION).set_index("method")
    assert list(table.index) == ["unified", "no_physics", "full"]
    assert table["decomposition"].tolist() == [False, True, True] and table["physics"].tolist() == [True, False, True]
    assert table["reference"].tolist() == [False, False, True]
    assert table.loc["unified", "cd_mean_difference"] == pytest.approx(0.3 * 1.035)
    assert table.loc["unified", "p"] == pytest.approx(2 / 256) and np.isnan(table.loc["full", "p"])
    assert table.loc["no_physics", "raw_min_jacobian_mean"] == pytest.approx(0.3)
    text = (tmp_path / "a.md").read_text()
    assert "| no | yes |" in text and "virtual cohort" in text and "against the full model" in text


def test_design_names_the_change_of_each_switch(tmp_path):
    named = {name: ", ".join(changes(FULL, settings)) for name, settings in reversed(VARIANTS.items())}
    assert named == {
        "full": "",
        "no_physics": "finetuning.weights.physics 0, pretraining.weights.physics 0",
        "unified": "network.decomposition False",
    }
    rows = cases(full=0.0, no_physics=-0.2, unified=0.3)
    write(design.table(rows, named, "virtual cohort", 0), tmp_path / "d.csv")
    table = read_table(tmp_path / "d.csv", DESIGN)
    assert table["change"].tolist() == list(named.values()) and table["method"][0] == "full"
    assert table["cd_mean_difference"][1] == pytest.approx(-0.2 * 1.035)
    assert "| unified |" in (tmp_path / "d.md").read_text()
