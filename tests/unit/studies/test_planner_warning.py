"""What the planner says against a forecast."""

from types import SimpleNamespace

import pytest

from pinnochio.patients.certificate import of_import
from pinnochio.plans.roles import GUESS
from studies.planner.page_words import APART, CROSS, OUTSIDE, WIDER, import_in_words, warning


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({}, ""),
        ({"damping": 5e-10}, "Not usable: the field turned tissue inside out and was scaled to 5e-08 %"),
        ({"repaired": 12}, "12 elements were turned inside out and solved again"),
        ({"off_bone": 5.04}, "Not usable: tissue is 5.0 mm off its bone"),
        ({"crossed": 1.25}, CROSS.format(1.25)),
        ({"apart": 2.5}, APART.format(2.5)),
        ({"beyond": 3.2}, "Not usable: 3.2 widths of the training's range beyond it"),
        ({"out_of_distribution": ("plan",)}, WIDER.format("plan")),
        ({"out_of_distribution": ("plan",), "out_of_range": True}, OUTSIDE.format("plan")),
    ],
)
def test_what_speaks_against_a_forecast_is_said(changes, words):
    none = {"damping": 1.0, "repaired": 0, "off_bone": 0.4, "crossed": 0.0, "apart": 2.0, "beyond": 0.0}
    none |= {"out_of_distribution": (), "out_of_range": False}
    forecast = SimpleNamespace(**none | changes)
    assert warning(forecast).startswith(words) and bool(warning(forecast)) == bool(words)


def test_a_guess_of_the_cuts_is_named_to_whoever_plans():
    quality = {"warnings": [], "care": [], "cuts": {"lefort1": f"the roots{GUESS}", "chin": "the plane that was given"}}
    assert import_in_words(of_import(quality)).startswith("Cuts by rule: lefort1. Nobody has said")
    assert import_in_words(of_import(quality | {"cuts": {}})) == ""
