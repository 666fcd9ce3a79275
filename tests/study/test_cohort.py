"""The virtual cohort as a benchmark: complete, described, summed up, and as patients are."""

import subprocess

import pandas as pd
import pytest

from pinnochio.columns import write_csv
from pinnochio.virtual import effects, nasolabial
from pinnochio.virtual.case_files import FILES
from pinnochio.virtual.effects import EVERYTHING, NOTHING
from pinnochio.virtual.ground_truth import EFFECTS, SCAN

ON = [name for name in EFFECTS if name != "contact"]  # off by default


@pytest.fixture(scope="module")
def cohort(studied):
    """The packed cohort; rows that are made up stand for the two measurements that take a minute."""
    folder = studied.folder / "results/quick/virtual"
    rows = [
        {"case": "V01", "effect": name, "mean": 0.5, "p95": 1.0, "lost": 0.0} for name in (NOTHING, *ON, EVERYTHING)
    ]
    write_csv(pd.DataFrame(rows), folder / "V01/effects.csv", effects.CASE)
    angles = pd.DataFrame([{"case": "V01", "before": 118.0, "after": 125.0}])
    write_csv(angles, folder / "V01/nasolabial.csv", nasolabial.CASE)
    studied.quick("--", "cohort")
    assert (pd.read_csv(folder / "V01/effects.csv")["mean"] == 0.5).all()  # not measured again
    return folder


def test_every_file_is_there_and_summed_up(cohort):
    listed = (cohort / "SHA256SUMS").read_text()
    for number in range(1, 5):
        for name in FILES:
            assert f"V{number:02d}/{name}" in listed
    checked = subprocess.run(["sha256sum", "--check", "SHA256SUMS"], cwd=cohort, capture_output=True, text=True)
    assert checked.returncode == 0, checked.stdout[-2000:]


def test_data_card_holds_the_tables(cohort):
    card = (cohort / "README.md").read_text()
    for name in ("thickness", "ratios", "nasolabial", "effects"):
        rows = (cohort / f"{name}.md").read_text().strip().splitlines()
        assert rows[2] in card, name
    for name in EFFECTS:
        assert name in card


@pytest.mark.full
def test_each_effect_changes_the_face_or_its_scan(studied, cohort):
    """One effect of each kind: tests/stages/test_outcome_tables.py."""
    made = "results/quick/virtual/effects.csv"
    studied.quick("--forcerun", "results/quick/virtual/V01/effects.csv", "--", made)
    table = pd.read_csv(studied.folder / made).set_index("effect")
    assert list(table.index) == [NOTHING, *ON, EVERYTHING]
    nothing = table.loc[NOTHING]
    assert nothing["mean"] < 0.1 and nothing["lost"] < 1
    scanned = [name for name, effect in EFFECTS.items() if effect.kind == SCAN]
    mechanics = table.iloc[1:].drop(index=[*scanned, EVERYTHING])
    assert (mechanics["mean"].drop("yielding") > 0.005).all()  # on a coarse mesh no tissue is squeezed so far
    assert table.loc["noise", "mean"] > nothing["mean"] + 0.05
    assert (table.loc[["holes", "coverage"], "lost"] > nothing["lost"] + 0.1).all()
    assert abs(table.loc["frame", "mean"] - nothing["mean"]) < 0.05  # registration takes it out
    assert table.loc[EVERYTHING, "mean"] > 0.5 * mechanics["mean"].max()


def test_soft_tissue_follows_the_bone(cohort):
    """Six coarse patients of the clinic's reality say little, but chins follow and noses follow least."""
    ours = pd.read_csv(cohort / "ratios.csv").set_index("ratio")["ours"]
    assert 0.5 < ours["Pog'"] < 1.2 and ours.drop("glabella (mm)").idxmin() == "Prn"
