"""Sampled plans: limits, the bond between both jaws, rami about their condyles, any set of segments."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from pinnochio.errors import InputError
from pinnochio.plans.plan import Plan, RigidMotion
from pinnochio.plans.sampling import (
    AUTOROTATION,
    DEFORMITIES,
    EXECUTION,
    LIMITS,
    PROXIMAL_ANGLE,
    PROXIMAL_SHIFT,
    WIDENING,
    JawAnatomy,
    execution_error,
    proximal_motion,
    raising,
    sample_plan,
)

SEGMENTS = ("lefort1", "mandible_distal", "proximal_left", "proximal_right")


def bones(segments=SEGMENTS):
    """Boxes of points where the segments are."""
    rng = np.random.default_rng(0)
    boxes = {
        "lefort1": ([-30, -95, -55], [30, -45, -25]),
        "mandible_distal": ([-30, -92, -92], [30, -40, -57]),
        "proximal_left": ([44, -48, -60], [52, -8, 0]),
        "proximal_right": ([-52, -48, -60], [-44, -8, 0]),
        "chin": ([-15, -90, -95], [15, -75, -80]),
        "lefort1_left": ([0, -95, -55], [30, -45, -25]),
        "lefort1_right": ([-30, -95, -55], [0, -45, -25]),
        "lefort1_front": ([-15, -95, -55], [15, -80, -25]),
    }
    whole = {"mandible": ("mandible_distal", "proximal_left", "proximal_right")}
    parts = [[rng.uniform(*boxes[part], (400, 3)) for part in whole.get(name, (name,))] for name in segments]
    points = [np.concatenate(part) for part in parts]
    return np.concatenate(points), np.repeat(np.arange(len(segments)), list(map(len, points)))


def angles(move):
    return Rotation.from_matrix(move.rotation).as_rotvec(degrees=True)


@pytest.fixture(scope="module")
def plans():
    points, segment = bones()
    return {
        d: [sample_plan(np.random.default_rng(s), "P", SEGMENTS, points, segment, d) for s in range(60)]
        for d in DEFORMITIES
    }


def test_motions_stay_within_practice(plans):
    points, segment = bones()
    anatomy = JawAnatomy.from_points(points, segment, SEGMENTS)
    for plan in (plan for group in plans.values() for plan in group):
        for name, what in (("lefort1", "maxilla"), ("mandible_distal", "distal")):
            shift, turn = LIMITS[what]
            move = plan.motion(name).translation * [1, -1, 1]
            assert (move >= shift[:, 0] - 1e-6).all() and (move <= shift[:, 1] + 1e-6).all()
            assert (np.abs(angles(plan.motion(name))) <= turn + 1e-6).all()
        for name in SEGMENTS[2:]:
            move = plan.motion(name)
            assert np.linalg.norm(angles(move)) <= PROXIMAL_ANGLE + 1e-6
            assert np.linalg.norm(move.displacement(anatomy.centre[name][None])) <= PROXIMAL_SHIFT + 1e-6
            assert np.allclose(move.pivot, anatomy.hinge[name])
            assert np.linalg.norm(move.translation) < 1.4  # the condyle stays in its socket


def test_deformities_move_the_right_way(plans):
    """Lower jaw against upper, at the bite: forward in Class II, back in Class III; up at the front in open bite."""
    bite = np.array([[0.0, -94, -56]])

    def relative(plan):
        return (plan.motion("mandible_distal").displacement(bite) - plan.motion("lefort1").displacement(bite))[0]

    mean = {d: np.mean([relative(plan) for plan in group], 0) for d, group in plans.items()}
    assert mean["class_ii"][1] < -3 and mean["class_iii"][1] > 4.5
    assert mean["open_bite"][2] > 2.5
    sideways = {d: np.mean([abs(relative(plan)[0]) for plan in group]) for d, group in plans.items()}
    assert sideways["asymmetry"] > 2.5 * sideways["class_ii"]


def test_jaws_are_correlated(plans):
    """The lower jaw travels with the upper: their vertical and sideways motions correlate over plans."""
    group = plans["class_ii"]
    upper, lower = (np.array([plan.motion(name).translation for plan in group]) for name in SEGMENTS[:2])
    assert np.corrcoef(upper[:, 0], lower[:, 0])[0, 1] > 0.6
    assert np.corrcoef(upper[:, 2], lower[:, 2])[0, 1] > 0.5


def test_rami_follow_the_distal_segment():
    """A purely sideways distal motion turns both rami to that side, a vertical one tips them up."""
    points, segment = bones()
    anatomy = JawAnatomy.from_points(points, segment, SEGMENTS)
    for axis in (0, 2):
        shift = np.zeros(3)
        shift[axis] = 5.0
        moved = [
            proximal_motion(np.random.default_rng(s), anatomy, name, RigidMotion(translation=shift)).displacement(
                anatomy.front[name][None]
            )[0, axis]
            for s in range(20)
            for name in SEGMENTS[2:]
        ]
        assert 0.5 < np.mean(moved) < 3.0


@pytest.mark.parametrize(
    "segments",
    [
        ("lefort1", "mandible_distal"),
        ("mandible_distal",),
        ("lefort1",),
        (*SEGMENTS, "chin"),
        ("lefort1", "mandible"),
        ("lefort1_left", "lefort1_right", "mandible", "chin"),
        ("lefort1_left", "lefort1_right", "lefort1_front", *SEGMENTS[1:]),
        ("mandible_distal", "proximal_left", "proximal_right"),
    ],
)
def test_any_set_of_segments(segments):
    points, segment = bones(segments)
    plan = sample_plan(np.random.default_rng(1), "P", segments, points, segment)
    assert set(plan.motions) == set(segments)
    anatomy = JawAnatomy.from_points(points, segment, segments)
    for name, move in plan.motions.items():
        assert np.linalg.norm(move.displacement(anatomy.front[name][None])) > 0.05
    assert Plan.from_json(plan.to_json(), case="P").motions.keys() == plan.motions.keys()


def test_an_uncut_mandible_turns_about_its_condyles_as_the_maxilla_lets_it():
    """Up with an impaction, down without; the condyles stay, and no turn is larger than a joint allows."""
    segments = ("lefort1", "mandible")
    points, segment = bones(segments)
    anatomy = JawAnatomy.from_points(points, segment, segments)
    hinge, front = anatomy.hinge["mandible"], anatomy.front["mandible"]
    assert abs(hinge[0]) < 5 and hinge[1] > -30 and hinge[2] > -20
    rises = []
    for seed in range(30):
        plan = sample_plan(np.random.default_rng(seed), "P", segments, points, segment)
        turn = plan.motion("mandible")
        assert np.allclose(turn.displacement(hinge[None]), 0, atol=1e-9) and np.allclose(angles(turn)[1:], 0)
        assert abs(angles(turn)[0]) <= AUTOROTATION + 1e-9
        upper, lower = (plan.motion(name).displacement(front[None])[0, 2] for name in segments)
        rises.append((upper, lower))
    assert np.corrcoef(np.array(rises).T)[0, 1] > 0.5
    up, down = (raising(anatomy, "mandible", rise).displacement(front[None])[0, 2] for rise in (3.0, -3.0))
    assert up == pytest.approx(3, abs=0.5) and down == pytest.approx(-3, abs=0.5)


@pytest.mark.parametrize("front", [False, True])
def test_pieces_of_a_maxilla_travel_together_and_get_wider_behind(front):
    pieces = ("lefort1_left", "lefort1_right", *(("lefort1_front",) if front else ()))
    segments = (*pieces, *SEGMENTS[1:])
    points, segment = bones(segments)
    anatomy = JawAnatomy.from_points(points, segment, segments)
    for seed in range(20):
        plan = sample_plan(np.random.default_rng(seed), "P", segments, points, segment)
        moved = {name: plan.motion(name).displacement(anatomy.centre[name][None])[0] for name in pieces}
        spread = max(np.linalg.norm(one - other) for one in moved.values() for other in moved.values())
        assert spread < 6.5
        behind = [plan.motion(name).displacement(anatomy.rear[name][None])[0, 0] for name in pieces[:2]]
        assert WIDENING[2] - 1.5 < behind[0] - behind[1] < WIDENING[3] + 1.5


def test_pieces_of_a_maxilla_share_the_error_of_the_splint():
    still = Plan("P", dict.fromkeys(("lefort1_left", "lefort1_right", "mandible"), RigidMotion()))
    rng = np.random.default_rng(1)
    done = [execution_error(still, rng) for _ in range(600)]
    one, other, jaw = (np.array([p.motion(name).translation for p in done]) for name in still.motions)
    for axis in range(3):
        assert np.corrcoef(one[:, axis], other[:, axis])[0, 1] > 0.9
        assert abs(np.corrcoef(one[:, axis], jaw[:, axis])[0, 1]) < 0.15
    assert np.allclose(np.abs(one).mean(0), EXECUTION[:3, 0], rtol=0.1)
    assert np.allclose(np.abs(jaw).mean(0), EXECUTION[:3, 0] / 2, rtol=0.1)


def test_chin_travels_with_the_jaw_and_further_forward():
    segments = (*SEGMENTS, "chin")
    points, segment = bones(segments)
    plan = sample_plan(np.random.default_rng(1), "P", segments, points, segment)
    chin = points[segment == 4]
    extra = plan.motion("chin").displacement(chin) - plan.motion("mandible_distal").displacement(chin)
    assert np.allclose(extra, [0, extra[0, 1], 0], atol=1e-9) and -10 <= extra[0, 1] < 0


def test_execution_error_has_the_published_size():
    """Mean and SD of the absolute error of 4,000 executions, within 6%; proximal segments half; scale 0 the plan."""
    still = Plan("P", {"lefort1": RigidMotion(), "proximal_left": RigidMotion()})
    rng = np.random.default_rng(0)
    done = [execution_error(still, rng) for _ in range(4000)]
    size = np.abs([[*p.motion("lefort1").translation, *angles(p.motion("lefort1"))] for p in done])
    assert np.allclose(size.mean(0), EXECUTION[:, 0], rtol=0.06)
    assert np.allclose(size.std(0), EXECUTION[:, 1], rtol=0.08)
    half = np.abs([p.motion("proximal_left").translation for p in done])
    assert np.allclose(half.mean(0), EXECUTION[:3, 0] / 2, rtol=0.06)
    assert np.allclose(execution_error(still, rng, scale=0.0).motion("lefort1").translation, 0)


def test_bad_segments_are_refused():
    points, segment = bones(("lefort1",))
    with pytest.raises(InputError, match="no points"):
        sample_plan(np.random.default_rng(0), "P", ("lefort1", "mandible_distal"), points, segment)
