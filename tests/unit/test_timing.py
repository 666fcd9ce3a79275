"""How often a timed prediction is made."""

import pytest

from pinnochio import timing


@pytest.mark.parametrize(("patience", "warm", "calls"), [(1e9, True, 4), (0.0, True, 2), (1e9, False, 1)])
def test_only_quick_predictions_are_repeated(monkeypatch, patience, warm, calls):
    monkeypatch.setattr(timing, "PATIENCE", patience)
    made = []
    result, seconds, setup = timing.timed(lambda: lambda: made.append(1) or len(made), warm)
    assert result == len(made) == calls
    assert seconds >= 0 and setup >= 0
