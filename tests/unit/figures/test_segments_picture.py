"""What the picture of an imported patient says beside the bones."""

from pinnochio.figures.segments import ROWS, _lines
from pinnochio.importing.repair import KEPT


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
    assert lines[-3:] == ["repairs: 108 voxels", "air: stray voxels to mandible_distal, 105", "air: hole to cranium, 3"]
    assert KEPT not in said


def test_the_picture_lists_the_largest_repairs():
    repairs = [{"structure": "air", "what": "hole to cranium", "voxels": number} for number in range(1, 40)]
    lines = _lines({"repairs": repairs})
    assert len(lines) == ROWS + 2 and lines[2].endswith(", 39") and lines[-1].endswith(f", {40 - ROWS}")
