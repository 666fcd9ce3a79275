"""Roles of segments, the ones that a case may have together, and which of them carries a place of the skeleton."""

import numpy as np
import pytest

from pinnochio.errors import InputError
from pinnochio.plans.plan import Plan, RigidMotion
from pinnochio.plans.roles import carriers, check_together, displacement_at, known_role, of_role, role

PIECES = ("lefort1_left", "lefort1_right", "lefort1_front")


def test_a_role_is_the_beginning_of_a_name():
    said = {
        "maxilla": ("lefort1", *PIECES, "maxilla"),
        "distal": ("mandible_distal", "distal"),
        "mandible": ("mandible",),
    }
    said |= {"proximal": ("proximal_left", "ramus_right"), "chin": ("chin", "genio")}
    for what, names in said.items():
        assert {role(name) for name in names} == {what} and of_role(["hyoid", *names], what) == [*names]
    assert known_role("hyoid") is None
    with pytest.raises(InputError, match="'hyoid' has no known role.*lefort"):
        role("hyoid")


@pytest.mark.parametrize(
    ("segments", "upper", "lower", "chin"),
    [
        (("lefort1", "mandible_distal", "proximal_left"), ["lefort1"], ["mandible_distal"], ["mandible_distal"]),
        (("mandible_distal", "chin"), [], ["mandible_distal"], ["chin"]),
        (("lefort1_left", "lefort1_right", "mandible"), ["lefort1_left", "lefort1_right"], ["mandible"], ["mandible"]),
        (PIECES, ["lefort1_front"], [], []),
    ],
)
def test_each_place_is_carried_by_what_the_case_has(segments, upper, lower, chin):
    assert [carriers(segments, place) for place in ("upper", "lower", "chin")] == [upper, lower, chin]


def test_a_place_between_two_pieces_goes_their_mean_way_and_an_uncut_one_stays():
    shifts = {"lefort1_left": [2.0, -4, 0], "lefort1_right": [-2.0, -6, 1]}
    plan = Plan("P", {name: RigidMotion(translation=np.array(shift)) for name, shift in shifts.items()})
    points = np.array([[0.0, -80, -50], [1, -80, -50]])
    np.testing.assert_allclose(displacement_at(plan, "upper", points), [[0, -5, 0.5]] * 2)
    assert not displacement_at(plan, "chin", points).any()


@pytest.mark.parametrize(
    ("segments", "words"),
    [
        ((), "holds no bone segment"),
        (("lefort1", "lefort1_left"), "'lefort1' is the whole bone, and its pieces lefort1_left"),
        (("mandible", "proximal_left"), "'mandible' is the whole bone"),
        (("mandible", "mandible_distal"), "'mandible' is the whole bone"),
    ],
)
def test_a_bone_and_its_pieces_are_refused(segments, words):
    with pytest.raises(InputError, match=words):
        check_together(segments, "P1", "head.nii.gz")


@pytest.mark.parametrize("segments", [("chin",), ("mandible", "chin"), (*PIECES, "mandible"), ("lefort1", "hyoid")])
def test_other_sets_are_cases(segments):
    check_together(segments, "P1", "head.nii.gz")
