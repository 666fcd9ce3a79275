"""What operations may move: blocks, bounds, occlusion; parameters to plans and back."""

import numpy as np
import pytest

from pinnochio.errors import InputError
from pinnochio.geometry.rigid import RigidMotion
from pinnochio.plans.plan import Plan
from pinnochio.plans.sampling import JawAnatomy, composed
from studies.inverse.freedom import LPS, OPERATIONS, QUANTITIES, freedom
from studies.inverse.inputs import check_bounds
from tests.helpers.patients import bony_patient
from tests.helpers.settings import CONFIG

BOUNDS = CONFIG["invert"]["bounds"]
BIMAXILLARY = ("lefort1", "mandible_distal", "proximal_left", "proximal_right", "chin")
MOVE = RigidMotion.from_degrees([2.0, -1, 1.5], [1.0, -3, 2], [3.0, -60, 10])


def free(segments, operation, occlusion=None):
    return freedom(bony_patient(segments), operation, BOUNDS, occlusion)


def some(freed, share=0.3):
    """Parameters inside the bounds."""
    return freed.low + (0.5 + share * np.sin(1 + np.arange(len(freed.low)))) * (freed.high - freed.low)


@pytest.mark.parametrize("operation", OPERATIONS)
def test_a_plan_and_its_parameters_are_the_same_thing(operation):
    freed = free(BIMAXILLARY, operation)
    x = some(freed)
    np.testing.assert_allclose(freed.nearest(freed.plan("-", x)), x, atol=1e-9)
    assert [quantity in QUANTITIES for _, quantity in freed.names] == [True] * len(x)


def test_only_the_jaws_of_an_operation_move_and_a_chin_that_is_not_cut_goes_with_its_jaw():
    plan = free(BIMAXILLARY, "mandible").plan("-", some(free(BIMAXILLARY, "mandible")))
    assert set(plan.motions) == {"mandible_distal", "proximal_left", "proximal_right", "chin"}
    np.testing.assert_allclose(plan.motion("chin").rotation, plan.motion("mandible_distal").rotation)
    point = np.array([[1.0, 2, 3]])
    np.testing.assert_allclose(plan.motion("chin").apply(point), plan.motion("mandible_distal").apply(point))


def test_rami_turn_about_their_condyles_and_nowhere_else():
    model = bony_patient(BIMAXILLARY)
    freed = freedom(model, "two_jaw", BOUNDS)
    hinge = JawAnatomy.from_points(model.bone_points, model.bone_segment, model.segments).hinge["proximal_left"]
    moved = freed.plan("-", some(freed)).motion("proximal_left")
    np.testing.assert_allclose(moved.apply(hinge[None])[0], hinge, atol=1e-9)
    assert not np.allclose(moved.rotation, np.eye(3))


def test_a_mandible_that_is_left_alone_turns_with_its_rami_as_one():
    freed = free(BIMAXILLARY, "maxilla")
    assert freed.names[-1] == ("mandible_turning", "pitch") and len(freed.names) == 7
    plan, point = freed.plan("-", some(freed)), np.array([[0.0, -70, -30]])
    places = {name: plan.motion(name).apply(point) for name in BIMAXILLARY[1:]}
    for place in places.values():
        np.testing.assert_allclose(place, places["mandible_distal"], atol=1e-9)


def test_an_uncut_mandible_can_but_turn():
    freed = free(("lefort1", "mandible"), "maxilla")
    assert freed.names[6:] == [("mandible_turning", "pitch")]
    assert free(("lefort1", "mandible"), "two_jaw") is None and free(("lefort1", "mandible"), "chin") is None


def test_pieces_of_a_maxilla_move_little_against_the_first():
    pieces = ("lefort1_left", "lefort1_right", "lefort1_front")
    freed = free((*pieces, "mandible"), "maxilla")
    assert [name for name, quantity in freed.names if quantity == "left"] == [pieces[2], *pieces[:2]]
    x = np.zeros(len(freed.low))
    x[:6] = [1, 2, 3, 2, 1, 1]
    plan, point = freed.plan("-", x), np.array([[5.0, -40, 2]])
    places = [plan.motion(name).apply(point) for name in pieces]
    np.testing.assert_allclose(places[0], places[2], atol=1e-9)  # nothing of their own yet
    widest = freed.high[freed.names.index((pieces[0], "left"))]
    assert widest == BOUNDS["piece"]["left"][1] < BOUNDS["maxilla"]["left"][1]


@pytest.mark.parametrize("operation", ["two_jaw", "two_jaw_chin", "maxilla", "mandible_chin"])
def test_the_occlusion_of_a_plan_is_kept(operation):
    prior = Plan("-", {"lefort1": MOVE, "mandible_distal": composed(MOVE, MOVE.fraction(0.5), MOVE.pivot)})
    freed = free(BIMAXILLARY, operation, prior)
    plan, point = freed.plan("-", some(freed, 0.2)), np.array([[4.0, -55, 3]])
    for planned in (prior, plan):  # where the upper jaw's point comes to lie in the frame of the lower one
        in_lower = planned.motion("mandible_distal").inverse(planned.motion("lefort1").apply(point))
        wanted = prior.motion("mandible_distal").inverse(prior.motion("lefort1").apply(point))
        np.testing.assert_allclose(in_lower, wanted, atol=1e-8)


def test_without_an_operation_on_the_maxilla_a_kept_occlusion_leaves_the_lower_jaw_no_choice():
    prior = Plan("-", {"lefort1": MOVE, "mandible_distal": composed(MOVE, MOVE.fraction(0.5), MOVE.pivot)})
    freed = free(BIMAXILLARY, "mandible", prior)
    assert {name for name, _ in freed.names} == {"proximal_left", "proximal_right"}
    assert not freed.plan("-", np.zeros(len(freed.low))).motions.get("lefort1")


def test_the_derivative_of_the_amplitudes_is_that_of_the_bones():
    freed = free(BIMAXILLARY, "two_jaw_chin")
    x = some(freed)
    step = 1e-4 * np.cos(np.arange(len(x)))
    change = freed.amplitudes(x + step) - freed.amplitudes(x - step)
    np.testing.assert_allclose(2 * freed.derivative(x) @ step, change, atol=1e-9)


def test_a_lever_is_the_motion_of_the_bones_per_unit():
    model = bony_patient(BIMAXILLARY)
    freed = freedom(model, "two_jaw", BOUNDS)
    number = freed.names.index(("lefort1", "pitch"))
    x = np.zeros(len(freed.low))
    x[number] = 0.1
    bone = model.bone_points[model.bone_segment == model.segments.index("lefort1")]
    moved = freed.plan("-", x).motion("lefort1").displacement(bone)
    assert np.sqrt((moved**2).sum(axis=1).mean()) == pytest.approx(0.1 * freed.lever[number], rel=1e-3)
    assert freed.lever[freed.names.index(("lefort1", "up"))] == 1
    np.testing.assert_array_equal(LPS * [0, 1, 0], [0, -1, 0])


def test_bounds_that_shut_out_the_place_at_rest_are_refused():
    check_bounds(BOUNDS)
    shut = BOUNDS | {"mandible": BOUNDS["mandible"] | {"forward": [1, 8]}}
    with pytest.raises(InputError, match=r"invert.bounds.mandible.forward is \[1, 8\]"):
        check_bounds(shut)
