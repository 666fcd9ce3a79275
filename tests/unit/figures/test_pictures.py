"""Pictures: what one of a training shows of its histories, and one of an imported patient says beside the bones."""

import matplotlib.figure
import numpy as np
import pandas as pd
import pytest

from pinnochio.figures.segments import ROWS, _lines
from pinnochio.figures.training import training_picture
from pinnochio.importing.repair import KEPT
from scripts.training.plot_training import plot_training


def history(steps=200, physics=True, every=50):
    """Losses that fall from 1 to 0.01, one residual of 1e9, a look every so many steps (none for 0)."""
    step = np.arange(steps + 1)
    fall = 10.0 ** (-2 * step / steps)
    table = pd.DataFrame({"step": step, "data": fall, "physics": np.nan, "boundary": fall / 3, "validation": np.nan})
    if physics:
        table["physics"] = 2 * fall
        table.loc[steps // 2, "physics"] = 1e9
    table.loc[steps, ["data", "physics", "boundary"]] = np.nan
    table["kept"] = 0.0
    if every:
        table.loc[::every, "validation"] = 1.5 * fall[::every]
        table.loc[steps - every, "kept"] = 1.0
    return table


@pytest.fixture
def drawn(monkeypatch):
    """The figures that are saved."""
    figures, save = [], matplotlib.figure.Figure.savefig
    monkeypatch.setattr(
        matplotlib.figure.Figure, "savefig", lambda self, *a, **k: figures.append(self) or save(self, *a, **k)
    )
    return figures


def test_curves_are_those_of_the_history_and_a_phase_without_a_step_is_not_drawn(drawn, tmp_path):
    training_picture({"pretraining": history(), "adaptation": history().iloc[:0]}, "x", tmp_path / "a.png")
    (axes,) = drawn[0].axes
    lines = {line.get_label(): line for line in axes.get_lines() if not line.get_label().startswith("_")}
    curve = lines["physics: equilibrium residual"].get_ydata()  # a running median, which an outlier does not move
    assert np.nanmax(curve) < 2.1 and curve[150] == pytest.approx(2 * 10**-1.5, rel=0.1)
    validation = lines["data term of the patients held back"]
    assert list(validation.get_xdata()) == [0, 50, 100, 150, 200] and validation.get_ydata()[0] == 1.5
    assert axes.get_yscale() == "log" and list(lines["weights kept"].get_xdata()) == [150]


def test_terms_and_looks_that_there_are_not_are_left_out(drawn, tmp_path):
    for name in ("pretraining", "finetuning"):
        history(physics=False, every=0).to_csv(tmp_path / f"{name}.csv", index=False)
    pictures = [tmp_path / f"{number}.png" for number in range(2)]
    for picture in pictures:
        plot_training(str(tmp_path / "pretraining.csv"), str(tmp_path / "finetuning.csv"), "x", str(picture))
    labels = [text.get_text() for text in drawn[0].axes[0].get_legend().get_texts()]
    assert [label.split(":")[0] for label in labels] == ["data", "boundary mismatch, mm²"]
    assert pictures[0].read_bytes() == pictures[1].read_bytes()


def test_the_picture_says_what_was_guessed_repaired_and_cannot_be_known():
    report = {
        "frame": {"sides": "unknown: nothing labelled tells left from right"},
        "soft_tissue": "the scan, above the grey value -480 (Otsu)",
        "cuts": {"lefort1": "5 mm above the roots of the upper teeth (a guess: look at the picture)"},
        "repairs": [
            {"structure": "air", "what": "hole to cranium", "voxels": 3},
            {"structure": "air", "what": "stray voxels to mandible_distal", "voxels": 105},
            {"structure": "air", "what": KEPT, "voxels": 797},
        ],
    }
    lines = _lines(report)
    said = " ".join(" ".join(lines).split())
    assert "frame, sides: unknown: nothing labelled tells left from right" in said
    assert "above the grey value -480 (Otsu)" in said and "a guess: look at the picture" in said
    assert lines[-3:] == [
        "repairs: 108 voxels",
        "  air: stray voxels to mandible_distal, 105",
        "  air: hole to cranium, 3",
    ]
    assert KEPT not in said


def test_the_picture_lists_the_largest_repairs():
    repairs = [{"structure": "air", "what": "hole to cranium", "voxels": number} for number in range(1, 40)]
    lines = _lines({"repairs": repairs})
    assert len(lines) == ROWS + 2 and lines[2].endswith(", 39") and lines[-1].endswith(f", {40 - ROWS}")
