"""The README shows the committed reference results, and nothing else."""

from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]


def test_readme_holds_the_reference_table():
    table = (ROOT / "results/reference/accuracy.md").read_text(encoding="utf-8").strip()
    assert table in (ROOT / "README.md").read_text(encoding="utf-8")


def test_readme_names_what_exists():
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    for path in ("config/README.md", "results/README.md", "docs/methods.md", "docs/patient.png", "CITATION.cff"):
        assert path in text and (ROOT / path).is_file()
