"""Names of methods as people write them: in cells, in sentences, in the twins of tables."""

import json

import pytest

from pinnochio.methods.names import spoken
from pinnochio.tables.formats import write_twins


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("fem_sliding", "Sliding FEM"),
        ("ratio", "Soft-to-hard ratios"),
        ("smallest volume ratio, linear elastic", "smallest volume ratio, linear elastic"),
        ("pinnochio before fem_rlse", "PINNOCHIO before FEM-RLSE, lips in contact"),
        ("Below no_change. no_change: 1 mm", "Below no change. No change: 1 mm"),
        ("random pinnochio_plus, repair", "random PINNOCHIO plus, repair"),
        ("beaten by design_narrow, corrections 1", "beaten by design narrow, corrections 1"),
        ("my_pinnochio_plus_2", "my_pinnochio_plus_2"),
    ],
)
def test_a_text_says_the_names_that_people_write(text, said):
    assert spoken(text) == said


def test_the_twins_say_them_too_and_html_keeps_the_short_one(tmp_path):
    block = {"headers": ["Method"], "rows": [[["fem_sliding", True]], [["own", False]]], "caption": "Of fem_sliding.",
             "title": ""}  # fmt: skip
    document = tmp_path / "a.json"
    document.write_text(json.dumps({"blocks": [block], "paragraphs": ["Also fem_sliding."], "columns": []}))
    write_twins(document)
    for suffix in (".md", ".tex"):
        text = document.with_suffix(suffix).read_text()
        assert text.count("liding FEM") == 3 and "fem_sliding" not in text
    assert '<td title="fem_sliding"><b>Sliding FEM</b></td>' in (page := document.with_suffix(".html").read_text())
    assert "<td>own</td>" in page
