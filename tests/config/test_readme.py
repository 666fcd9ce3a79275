"""The README and the pages show the committed reference results, and lead to what exists."""

import json
import re
import shlex
import subprocess
from pathlib import Path

import pandas as pd
import pytest

from pinnochio.code import closure
from tests.helpers.documents import PAGES
from tests.helpers.settings import ROOT

REFERENCE = ROOT / "results/reference"
SHORT = [ROOT / "README.md", ROOT / "docs/results/README.md"]
SHORT_ROWS = {
    "no change": "no_change",
    "linear elasticity": "elastic",
    "sliding finite elements": "fem_sliding",
    "PINNOCHIO, as published": "pinnochio",
    "PINNOCHIO plus": "pinnochio_plus",
}
STUDIES = sorted((ROOT / "workflow/studies").glob("*/README.md"))
CODE = ("scripts", "slicer", "tests", "workflow")
CHECKED = [ROOT / "README.md", *sorted((ROOT / "docs/results").glob("*.md")), *STUDIES]
# Runs of docs/results/how_made.md: tables, commit, date, code since, machine; and what makes every table.
RUNS = [line.strip("| ").split(" | ") for line in (ROOT / "docs/results/how_made.md").read_text().splitlines()]
RUNS = [run for run in RUNS if len(run) == 5 and "`" in run[1]]
STAGES = (
    "cohort/[sv]*",
    "fem/*",
    "patient/[!s]*",
    "training/f*",
    "training/pre*",
    "prediction/predict",
    "tables/[et]*",
)
NETWORKS = ("workflow/pinnochio/methods", "workflow/pinnochio/networks", "workflow/pinnochio/training")
DECIMAL = re.compile(r"(?<![\w.])\d+\.\d+(?:e-?\d+)?")


def checks(page: Path) -> list[str]:
    """What a page says of its numbers, in a comment at its end.

    A line is `1.25 accuracy method=pinnochio_plus cd_mean`: number, table, rows, column, and if they are several
    rows what is made of them (`mean`, `median`, `min`, `max`, `positive`, or `below=METHOD`: on how many patients the
    value lies below that method's). `%` behind a number: the table has a share. `set`: a setting, in no table.
    """
    block = re.search(r"<!-- numbers\n(.*?)-->", page.read_text(encoding="utf-8"), re.S)
    return block[1].splitlines() if block else []


def looked_up(table: str, *words: str) -> float:
    """The number that a line of :func:`checks` names."""
    rows = pd.read_csv(REFERENCE / f"{table}.csv")
    keys = [word.split("=") for word in words if "=" in word and not word.startswith("below=")]
    column, *how = [word for word in words if word.startswith("below=") or "=" not in word]
    everyone = rows
    for key, value in keys:
        rows = rows[rows[key].astype(str) == value]
    if not how:
        assert len(rows) == 1, words
        return rows[column].item()
    if how[0].startswith("below="):
        other = everyone[everyone["method"] == how[0].removeprefix("below=")].set_index("case")[column]
        return (rows.set_index("case")[column] < other).sum()
    return (rows[column] > 0).sum() if how[0] == "positive" else getattr(rows[column], how[0])()


@pytest.mark.parametrize("page", CHECKED, ids=lambda page: str(page.relative_to(ROOT)))
def test_numbers_are_those_of_the_tables(page):
    """Each decimal of the text is in the page's list, and each line of the list agrees with its table to the last
    digit that is shown. Tables of a page are held by the tests below."""
    text = re.sub(
        r"<!--.*?-->|```.*?```|`[^`]*`|\]\([^)]*\)|^\|.*?$", "", page.read_text(encoding="utf-8"), flags=re.S | re.M
    )
    listed = set()
    for line in checks(page):
        number, *words = shlex.split(line)
        listed.add(number.strip("-%"))
        if words == ["set"]:
            continue
        mantissa, _, exponent = number.rstrip("%").partition("e")
        digit = 10.0 ** (int(exponent or 0) - len(mantissa.partition(".")[2]))
        value = looked_up(*words) * (100 if number.endswith("%") else 1)
        assert float(number.rstrip("%")) == pytest.approx(value, rel=0, abs=0.5001 * digit), line
    assert not set(DECIMAL.findall(text)) - listed


@pytest.mark.parametrize("cohort", ["development", "locked"])
def test_results_hold_the_reference_table(cohort):
    """Every method in the order of the table: CD, share within 2 mm, seconds, explained share, Holm's p."""
    text = (ROOT / f"docs/results/{cohort}.md").read_text(encoding="utf-8")
    rows = pd.read_csv(REFERENCE / ("locked" if cohort == "locked" else "") / "better.csv").query("not bound")
    lines = [
        f"| `{row.method}` | {row.cd_mean:.3f} ± {row.cd_sd:.3f} | {row.pwr2_mean:.1f} | {row.seconds_mean:.3f} "
        f"| {100 * row.explained:.1f} | {'' if pd.isna(row.p_holm) else f'{row.p_holm:.2g}'} |"
        for row in rows.itertuples()
    ]
    assert "\n".join(lines) in text


@pytest.mark.parametrize("page", SHORT, ids=["README", "results"])
def test_short_tables_hold_five_rows_of_the_reference(page):
    """Those of the locked cohort, rounded, with their day; seconds are those of the table or rounded."""
    text = page.read_text(encoding="utf-8")
    accuracy = pd.read_csv(REFERENCE / "locked/accuracy.csv").set_index("method")
    shown = {row[0]: row for row in (line.strip("| ").split(" | ") for line in text.splitlines()) if len(row) == 4}
    for name, method in SHORT_ROWS.items():
        measured, row = accuracy.loc[method], [cell.strip("*") for cell in shown[name]]
        assert row[1:3] == [f"{measured['cd_mean']:.2f} ± {measured['cd_sd']:.2f}", f"{measured['pwr2_mean']:.1f}"]
        assert float(row[3]) == pytest.approx(measured["seconds_mean"], rel=0.1, abs=0.001)
    assert json.loads((REFERENCE / "locked/provenance.json").read_text())["written"][:10] in text


@pytest.mark.parametrize("run", RUNS, ids=[run[0] for run in RUNS])
def test_the_page_marks_what_is_older_than_its_code(run):
    """The commit is that of the provenance, and `changed` says whether a file that makes the table is another since."""
    tables, commits, since = re.findall(r"`(\w+)`", run[0]), re.findall(r"`(\w+)`", run[1]), run[3]
    for record in filter(Path.is_file, (REFERENCE / f"{table}.provenance.json" for table in tables)):
        assert json.loads(record.read_text())["commit"].startswith(tuple(commits)), record.name
    rules = {file.parent: file.read_text(encoding="utf-8") for file in ROOT.glob("workflow/studies/*/rules.smk")}
    studies = [folder for folder, text in rules.items() if any(re.search(rf"\b{table}\b", text) for table in tables)]
    made = [file for part in STAGES for file in ROOT.glob(f"scripts/{part}.py")]
    made = closure(*made, *(file for folder in studies for file in folder.glob("*.py")))
    compared = ["git", "-C", ROOT, "diff", "--quiet", commits[-1], "--", *made, *map(ROOT.joinpath, NETWORKS)]
    code = subprocess.run(compared, capture_output=True, check=False).returncode
    if code > 1:
        pytest.skip("the clone does not hold the commit")
    assert since == ("changed" if code else "as it is")


def test_readme_is_short():
    lines = (ROOT / "README.md").read_text(encoding="utf-8").splitlines()
    assert len(lines) <= 130 and max(map(len, lines)) <= 120


@pytest.mark.parametrize("name", ["thickness", "ratios", "structure"])
def test_docs_hold_the_tables_of_the_cohort(name):
    table = (ROOT / f"results/reference/{name}.md").read_text(encoding="utf-8").strip()
    assert table in (ROOT / "docs/lab/cohort.md").read_text(encoding="utf-8")


def test_the_page_of_a_registry_holds_what_was_measured():
    text = (ROOT / "docs/how-to/registry.md").read_text(encoding="utf-8")
    for row in pd.read_csv(REFERENCE / "scaling_patients.csv").dropna().itertuples():
        planning = f"{row.planning:.1f}, {row.planning_memory:.0f} | {row.training_memory:,.0f}"
        assert f"| {row.patients:,} | {row.jobs:,.0f} | {planning} |" in text


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


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_modules_that_a_page_names_exist(page):
    """By their path, or the end of it."""
    modules = [f"/{path.relative_to(ROOT)}" for folder in CODE for path in (ROOT / folder).rglob("*.py")]
    text = re.sub(r"```.*?```", "", page.read_text(encoding="utf-8"), flags=re.S)
    for name in re.findall(r"`([\w./-]+/\w+\.py)`", text):
        assert "lab" in page.parts or any(path.endswith(f"/{name}") for path in modules), name


@pytest.mark.parametrize("index", [ROOT / "docs/README.md", ROOT / "docs/lab/README.md"], ids=["docs", "lab"])
def test_the_index_leads_to_every_page(index):
    text = index.read_text(encoding="utf-8")
    for page in index.parent.rglob("*.md"):
        in_lab = page.parent.name == "lab" and page.name != "README.md"
        elsewhere = in_lab and index.parent.name != "lab"  # the lab has an index of its own
        assert page == index or elsewhere or f"({page.relative_to(index.parent)})" in text, page.name
