"""Pictures: what one of a training shows of its histories, and one of an imported patient says beside the bones."""

import matplotlib.figure
import numpy as np
import pandas as pd
import pytest

from pinnochio.figures.segments import ROWS, _lines
from pinnochio.figures.training import TERMS, running_median, training_picture
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


def test_running_median_ignores_an_outlier_and_follows_the_rest():
    values = np.arange(20.0)
    values[7] = 1e9
    assert np.allclose(running_median(values, 5)[[2, 5, 7, 12]], [2, 5, 8, 12], atol=1)
    assert np.array_equal(running_median(values, 1), values)


def test_curves_are_those_of_the_history(drawn, tmp_path):
    training_picture({"pretraining": history(), "adaptation": history(40, every=10)}, "x", tmp_path / "a.png")
    left, right = drawn[0].axes
    assert [axes.get_title() for axes in (left, right)] == ["pretraining", "adaptation"]
    assert left.get_yscale() == "log" and (left.get_xlim()[1], right.get_xlim()[1]) == (200, 40)
    lines = {line.get_label(): line for line in left.get_lines() if not line.get_label().startswith("_")}
    assert [name.split(":")[0] for name in lines] == [
        "data", "physics", "boundary mismatch, mm²", "data term of the patients held back", "weights kept",
    ]  # fmt: skip
    curve = lines["physics: equilibrium residual"].get_ydata()
    assert np.nanmax(curve) < 2.1 and curve[150] == pytest.approx(2 * 10**-1.5, rel=0.1)
    validation = lines["data term of the patients held back"]
    assert list(validation.get_xdata()) == [0, 50, 100, 150, 200] and validation.get_ydata()[0] == 1.5
    assert list(lines["weights kept"].get_xdata()) == [150]
    assert len({str(line) for _, line, _ in TERMS.values()}) == len(TERMS)  # in grey, terms differ by their line
    assert right.get_lines()[1].get_label() == "data: skin distance, mm"


def test_a_phase_without_a_step_is_not_drawn(drawn, tmp_path):
    training_picture({"pretraining": history(), "adaptation": history().iloc[:0]}, "x", tmp_path / "a.png")
    assert [axes.get_title() for axes in drawn[0].axes] == ["pretraining"]


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
