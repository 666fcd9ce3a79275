"""What the planner says against a forecast."""

from types import SimpleNamespace

import pytest

from pinnochio.planner.page import _warning


@pytest.mark.parametrize(
    ("own", "words"),
    [
        ({}, ""),
        ({"damping": 5e-10}, "Not usable: the field turned tissue inside out and was scaled to 5e-08 %"),
        ({"repaired": 12}, "12 elements were turned inside out and solved again"),
        ({"beyond": 3.2}, "Not usable: 3.2 widths of the training's range beyond it"),
        ({"out_of_distribution": ("plan",)}, "Unlike the training in plan"),
    ],
)
def test_what_speaks_against_a_forecast_is_said(own, words):
    forecast = SimpleNamespace(**{"damping": 1.0, "repaired": 0, "beyond": 0.0, "out_of_distribution": ()} | own)
    assert _warning(forecast).startswith(words) and bool(_warning(forecast)) == bool(words)
