"""The README shows the committed reference results, and nothing else."""

from pathlib import Path

import pandas as pd
import pytest

ROOT = Path(__file__).resolve().parents[2]


def test_readme_holds_the_reference_table():
    text = (ROOT / "results/reference/accuracy.md").read_text(encoding="utf-8")
    table = "\n\n".join(text.strip().split("\n\n")[:2])  # ours and its caption; the paper's values follow them
    assert table in (ROOT / "README.md").read_text(encoding="utf-8")


@pytest.mark.parametrize("name", ["thickness", "ratios", "effects"])
def test_docs_hold_the_tables_of_the_cohort(name):
    table = (ROOT / f"results/reference/{name}.md").read_text(encoding="utf-8").strip()
    assert table in (ROOT / "docs/cohort.md").read_text(encoding="utf-8")


def test_readme_names_what_exists():
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    pages = (
        "config/README.md",
        "results/README.md",
        "docs/methods.md",
        "docs/networks.md",
        "docs/mechanics.md",
        "docs/benchmark.md",
        "docs/cohort.md",
        "docs/patients.md",
        "docs/planner.md",
    )
    for path in (*pages, "docs/heads.png", "CITATION.cff"):
        assert path in text and (ROOT / path).is_file()


def test_reference_cohort_is_as_patients_are():
    """Soft-to-hard tissue ratios inside the clinical bands, thickness within one published standard deviation."""
    ratios = pd.read_csv(ROOT / "results/reference/ratios.csv")
    assert len(ratios) == 7 and ratios["inside"].all()
    assert ((ratios["ours"] >= ratios["low"]) & (ratios["ours"] <= ratios["high"])).all()
    thickness = pd.read_csv(ROOT / "results/reference/thickness.csv")
    assert len(thickness) == 12
    assert ((thickness["ours_mean"] - thickness["published_mean"]).abs() < thickness["published_sd"]).all()
