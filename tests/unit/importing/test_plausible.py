"""Bones held against people's: what is refused, what asks for care, and the page that says how large bones are."""

import re

import numpy as np
import pytest

from pinnochio.errors import InputError
from pinnochio.importing import plausible
from pinnochio.importing.plausible import judged, unlike_people
from pinnochio.model.labels import CRANIUM
from tests.helpers.settings import ROOT

SEGMENTS = ("lefort1", "mandible_distal", "proximal_left", "proximal_right")
SPACING = np.full(3, 2.0)


def head(right=12, distal=16, behind=True):
    """Boxes of bone: 2 mm voxels; `right`: length of the right ramus, `distal`: height of the body, voxels."""
    labels = np.zeros((70, 60, 80), np.uint8)
    labels[15:55, 5:45, 55:75] = CRANIUM
    labels[18:52, 5:25, 42:54] = 11
    labels[18:52, 5:15, 20 : 20 + distal] = 12
    labels[50:56, 30:42, 20:40] = 13
    labels[14:20, 30 : 30 + right, 20:40] = 14
    return labels if behind else labels[:, ::-1]


def words(**changes) -> str:
    return "; ".join(said for said, _ in unlike_people(head(**changes), SPACING, SEGMENTS))


def test_a_head_of_usual_size_is_like_people():
    assert words() == ""


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"right": 26}, "larger of proximal_left and proximal_right by the smaller: 2.17 times"),
        ({"right": 1}, "proximal_right: 0.96 cm3, usual are 3.5 to 35"),
        ({"distal": 6}, "share of the mandible in front of the rami: 41.5 %"),
        ({"behind": False}, "proximal_left lies in front of mandible_distal"),
    ],
)
def test_what_is_unlike_is_said_with_its_figure(changes, said):
    assert said in words(**changes)


def test_what_the_border_cuts_may_be_small():
    labels = head(right=1)
    assert "proximal_right:" not in "; ".join(said for said, _ in unlike_people(labels[14:], SPACING, SEGMENTS))


def test_out_of_range_asks_for_care_and_far_out_or_cut_by_rule_for_a_yes():
    odd = unlike_people(head(right=26), SPACING, SEGMENTS)
    assert judged(odd, False, False, "P1", "a") == [said for said, _ in odd]
    with pytest.raises(InputError, match="the cuts by rule make pieces unlike people's: larger of.*osteotomy.accept"):
        judged(odd, False, True, "P1", "a")
    far = unlike_people(head(right=1), SPACING, SEGMENTS)
    with pytest.raises(InputError, match="unlike anybody's: proximal_right.*osteotomy.accept"):
        judged(far, False, False, "P1", "a")
    assert judged(far, True, True, "P1", "a")


def test_the_page_gives_the_ranges_that_are_checked():
    page = (ROOT / "docs/reference/anatomy.md").read_text(encoding="utf-8")
    stated = [tuple(map(float, pair)) for pair in re.findall(r"^\|[^|]*\| ([\d.]+)-([\d.]+)", page, re.M)]
    checked = [*plausible.BONES.values(), *plausible.PIECES.values(), *plausible.WIDTHS.values()]
    assert stated == [*checked, (100 * plausible.DISTAL, 100), (1, plausible.SIDES)]
