"""The README and the pages show the committed reference results, and lead to what exists."""

import json
import re
from pathlib import Path

import pandas as pd
import pytest

from tests.helpers.documents import PAGES
from tests.helpers.settings import ROOT

README_ROWS = {
    "no change": "no_change",
    "linear elasticity": "elastic",
    "sliding finite elements": "fem_sliding",
    "PINNOCHIO, as published": "pinnochio",
    "PINNOCHIO plus": "pinnochio_plus",
}


@pytest.mark.parametrize("name", ["accuracy", "locked/better"])
def test_results_hold_the_reference_table(name):
    text = (ROOT / f"results/reference/{name}.md").read_text(encoding="utf-8")
    table = "\n\n".join(text.strip().split("\n\n")[:2])  # ours and its caption; the paper's values follow them
    assert table in (ROOT / "docs/results/README.md").read_text(encoding="utf-8")


def test_readme_holds_five_rows_of_the_reference():
    """Those of the locked cohort, rounded, with the day that they are of; seconds are those of the table or rounded."""
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    accuracy = pd.read_csv(ROOT / "results/reference/locked/accuracy.csv").set_index("method")
    shown = {row[0]: row for row in (line.strip("| ").split(" | ") for line in text.splitlines()) if len(row) == 4}
    for name, method in README_ROWS.items():
        own, row = accuracy.loc[method], [cell.strip("*") for cell in shown[name]]
        assert row[1:3] == [f"{own['cd_mean']:.2f} ± {own['cd_sd']:.2f}", f"{own['pwr2_mean']:.1f}"]
        assert float(row[3]) == pytest.approx(own["seconds_mean"], rel=0.1, abs=0.001)
    assert json.loads((ROOT / "results/reference/locked/provenance.json").read_text())["written"][:10] in text


def test_readme_is_short():
    lines = (ROOT / "README.md").read_text(encoding="utf-8").splitlines()
    assert len(lines) <= 130 and max(map(len, lines)) <= 120


@pytest.mark.parametrize("name", ["thickness", "ratios", "effects"])
def test_docs_hold_the_tables_of_the_cohort(name):
    table = (ROOT / f"results/reference/{name}.md").read_text(encoding="utf-8").strip()
    assert table in (ROOT / "docs/explanation/cohort.md").read_text(encoding="utf-8")


def anchors(page: Path) -> set[str]:
    """What GitHub calls the headings of a page."""
    headings = re.findall(r"^#+ (.*)$", page.read_text(encoding="utf-8"), re.M)
    return {re.sub(r"[^\w -]", "", heading).lower().replace(" ", "-") for heading in headings}


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_links_lead_somewhere(page):
    for file, anchor in re.findall(r"\]\((?!https?:)([^)#\s]*)#?([^)\s]*)\)", page.read_text(encoding="utf-8")):
        target = page.parent / file if file else page
        assert target.exists(), file
        assert not anchor or anchor in anchors(target), anchor


def test_the_index_leads_to_every_page():
    index = ROOT / "docs/README.md"
    text = index.read_text(encoding="utf-8")
    for page in (ROOT / "docs").rglob("*.md"):
        assert page == index or f"({page.relative_to(ROOT / 'docs')})" in text, page.name


def test_reference_cohort_is_as_patients_are():
    """Soft-to-hard tissue ratios are said to be inside or outside the clinical bands as they are; thickness lies within
    one published standard deviation but where the page says that it does not."""
    ratios = pd.read_csv(ROOT / "results/reference/ratios.csv")
    assert len(ratios) == 7
    assert (ratios["inside"] == ((ratios["ours"] >= ratios["low"]) & (ratios["ours"] <= ratios["high"]))).all()
    thickness = pd.read_csv(ROOT / "results/reference/thickness.csv")
    assert len(thickness) == 12
    beyond = (thickness["ours_mean"] - thickness["published_mean"]).abs() >= thickness["published_sd"]
    assert list(thickness["landmark"][beyond]) == ["subnasale"]
