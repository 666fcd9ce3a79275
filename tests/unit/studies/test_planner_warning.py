"""What the planner says against a forecast."""

from types import SimpleNamespace

import pytest

from studies.planner.page_words import warning


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({}, ""),
        ({"damping": 5e-10}, "Not usable: the field turned tissue inside out and was scaled to 5e-08 %"),
        ({"repaired": 12}, "12 elements were turned inside out and solved again"),
        ({"off_bone": 5.04}, "Not usable: tissue that slides is 5.0 mm off its bone"),
        ({"beyond": 3.2}, "Not usable: 3.2 widths of the training's range beyond it"),
        ({"out_of_distribution": ("plan",)}, "Unlike the training in plan"),
    ],
)
def test_what_speaks_against_a_forecast_is_said(changes, words):
    none = {"damping": 1.0, "repaired": 0, "off_bone": 0.4, "beyond": 0.0, "out_of_distribution": ()}
    forecast = SimpleNamespace(**none | changes)
    assert warning(forecast).startswith(words) and bool(warning(forecast)) == bool(words)
