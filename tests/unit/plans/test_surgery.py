"""Motions in surgeons' words and back."""

import numpy as np
import pytest

from pinnochio.geometry.rigid import RigidMotion
from pinnochio.plans.surgery import AMOUNTS, amount, amounts, in_words, motion_of

# A face that looks to -y: forehead, chin and sides in LPS.
FRONT, TOP, LEFT = np.array([0.0, -10, 0]), np.array([0.0, 0, 10]), np.array([10.0, 0, 0])
REST = dict.fromkeys(AMOUNTS, 0.0)


def moved(point, **parts):
    return motion_of(REST | parts, np.zeros(3)).apply(point[None])[0] - point


@pytest.mark.parametrize(
    ("parts", "point", "direction"),
    [
        ({"advance": 5}, FRONT, (0, -5, 0)),
        ({"up": 2}, FRONT, (0, 0, 2)),
        ({"left": 3}, FRONT, (3, 0, 0)),
        ({"yaw": 90}, FRONT, (10, 10, 0)),  # front to the left
        ({"roll": 90}, LEFT, (-10, 0, -10)),  # left side down
        ({"pitch": 90}, FRONT, (0, 10, -10)),  # front down
    ],
    ids=lambda case: "-".join(case) if isinstance(case, dict) else "",
)
def test_a_positive_amount_does_what_its_word_says(parts, point, direction):
    np.testing.assert_allclose(moved(point, **parts), direction, atol=1e-9)


def test_amounts_and_motion_are_each_others_inverse():
    motion = RigidMotion.from_degrees([3, -2, 7], [1, -4, 2.5], [10, -60, 5])
    again = motion_of(amounts(motion), motion.pivot)
    for part in ("rotation", "translation", "pivot"):
        np.testing.assert_allclose(getattr(again, part), getattr(motion, part), atol=1e-12)


def test_words_name_the_way_and_leave_out_what_does_not_move():
    motion = motion_of(REST | {"advance": 5, "up": 2, "yaw": -1.04}, np.zeros(3))
    assert in_words(motion, "lefort1") == "advanced 5.0 mm, impacted 2.0 mm, yaw 1.0° (front to the right)"
    assert in_words(motion_of(REST | {"advance": -4, "up": -1, "left": 2}, np.zeros(3)), "mandible_distal") == (
        "set back 4.0 mm, down 1.0 mm, 2.0 mm to the left"
    )
    assert in_words(motion_of(REST | {"up": -3, "roll": 0.04}, np.zeros(3)), "chin") == "lengthened 3.0 mm"
    assert in_words(RigidMotion(), "lefort1") == "not moved"
    assert (amount("up", "lefort1").more, amount("up", "proximal_left").more) == ("impact", "up")
