"""What hangs together in a jaw: carried rami and chin, a locked and a final occlusion, collisions, limits, presets."""

import numpy as np
import pytest

from pinnochio.plans.plan import Plan
from pinnochio.plans.surgery import AMOUNTS, amounts, motion_of
from studies.planner.jaws import CRANIUM, LIMIT, OVERBITE, OVERJET, Jaws, named
from studies.planner.page_words import COLLIDE, USUAL, overlaps
from studies.planner.session import PRESETS, Session
from tests.helpers.virtual_heads import face_alone

JAW = "mandible_distal"
RAMI = ("proximal_left", "proximal_right")


@pytest.fixture(scope="module")
def patient():
    return face_alone("class_ii")


@pytest.fixture
def session(patient, tmp_path):
    return Session(patient, "V", {}, tmp_path)


def test_a_mandible_takes_its_rami_along_and_leaves_the_condyles(session, patient):
    session.change(JAW, "left", 5.0)
    for ramus in RAMI:
        motion = session.draft.plan.motion(ramus)
        assert np.abs(motion.degrees).max() > 0.3
        condyle = session.jaws.anatomy.hinge[ramus][None]
        np.testing.assert_allclose(motion.displacement(condyle), 0, atol=1e-9)
    session.change(JAW, "left", 0.0)  # the way there leaves nothing behind
    assert session.draft.plan.still
    session.carry = False
    session.change(JAW, "left", 5.0)
    assert all(Plan("", {ramus: session.draft.plan.motion(ramus)}).still for ramus in RAMI)


def test_a_ramus_that_is_turned_by_hand_turns_about_its_condyle(session):
    session.change(RAMI[1], "yaw", 5.0)
    motion = session.draft.plan.motion(RAMI[1])
    np.testing.assert_allclose(motion.displacement(session.jaws.anatomy.hinge[RAMI[1]][None]), 0, atol=1e-9)
    assert np.abs(motion.degrees).max() > 4


def test_a_ramus_keeps_what_was_planned_for_itself(session):
    session.change(RAMI[0], "yaw", 2.0)
    session.change(JAW, "up", 4.0)
    assert amounts(session.draft.plan.motion(RAMI[0]))["yaw"] == pytest.approx(2.0, abs=0.2)
    session.change(JAW, "up", 0.0)
    assert amounts(session.draft.plan.motion(RAMI[0])) == pytest.approx(
        dict.fromkeys(AMOUNTS, 0.0) | {"yaw": 2.0}, abs=1e-9
    )


def test_locked_jaws_keep_their_occlusion_whichever_is_moved(session, patient):
    session.locked = True
    session.change("lefort1", "advance", 4.0)
    session.change("lefort1", "yaw", 3.0)
    session.change(JAW, "up", -2.0)
    upper, lower = (session.draft.plan.motion(name) for name in ("lefort1", JAW))
    points = patient.bone_points
    np.testing.assert_allclose(upper.apply(points), lower.apply(points), atol=1e-9)
    session.locked = False
    session.change("lefort1", "advance", 0.0)
    assert not np.allclose(session.draft.plan.motion("lefort1").apply(points), lower.apply(points))


def test_the_final_occlusion_puts_the_incisors_in_place(patient):
    jaws = Jaws(patient)
    upper, lower = jaws._edges
    plan = Plan("V", {"lefort1": motion_of(dict.fromkeys(AMOUNTS, 0.0) | {"advance": 4.0}, np.zeros(3))})
    gap = jaws.final(plan, None).apply(lower[None])[0] - plan.motion("lefort1").apply(upper[None])[0]
    np.testing.assert_allclose(gap, [0, OVERJET, OVERBITE], atol=1e-9)
    # The relation of another plan is kept wherever the maxilla goes.
    other = Plan("V", plan.motions | {JAW: motion_of(dict.fromkeys(AMOUNTS, 0.0) | {"advance": 7.0}, np.zeros(3))})
    relation = jaws.relation(other)
    assert amounts(relation)["advance"] == pytest.approx(3.0)
    np.testing.assert_allclose(jaws.final(other, relation).apply(lower[None]), other.motion(JAW).apply(lower[None]))
    assert jaws.relation(Plan("V", {})) is None


@pytest.mark.parametrize("name", [name for name in PRESETS if "Chin" not in name])
def test_a_preset_does_what_its_name_says(session, name):
    assert session.presets == [preset for preset in PRESETS if "Chin" not in preset]  # no chin is cut
    session.preset(name)
    for part, amount in PRESETS[name].items():
        (segment,) = {"maxilla": session.jaws.upper, "lower": session.jaws.lower}[part]
        if amount == "final":
            assert not Plan("", {segment: session.draft.plan.motion(segment)}).still
        else:
            assert session.values(segment) == pytest.approx(dict.fromkeys(AMOUNTS, 0.0) | amount)
    session.draft.undo()
    assert session.draft.plan.still and not session.draft.can_undo  # one step


def test_bones_that_run_into_each_other_are_named_and_shown(patient):
    jaws = Jaws(patient)
    rest, where = jaws.collisions(Plan("V", {}))
    assert not rest and where.shape == (0, 3)
    closed = Plan("V", {JAW: motion_of(dict.fromkeys(AMOUNTS, 0.0) | {"up": 5.0}, np.zeros(3))})
    deep, where = jaws.collisions(closed)
    assert ("lefort1", JAW) in deep and 1 < deep["lefort1", JAW] <= 6 and len(where)
    opened = Plan("V", {JAW: motion_of(dict.fromkeys(AMOUNTS, 0.0) | {"up": -8.0}, np.zeros(3))})
    assert ("lefort1", JAW) not in jaws.collisions(opened)[0]
    # Both jaws together run into nothing of each other, but into the skull.
    both = jaws.collisions(Plan("V", dict.fromkeys(patient.segments, closed.motion(JAW))))[0]
    assert both and all(CRANIUM in pair for pair in both)


def test_each_kind_of_overlap_has_its_sentence_and_its_limit(patient):
    jaws = Jaws(patient)
    kinds = {"cut": (JAW, RAMI[0]), "removed": ("lefort1", CRANIUM), "teeth": ("lefort1", JAW), "bone": RAMI}
    for kind, pair in kinds.items():
        assert jaws.kind(*pair) == jaws.kind(*pair[::-1]) == kind
        for depth, said in ((LIMIT[kind], (USUAL, [])), (LIMIT[kind] + 0.1, ([], COLLIDE))):
            expected = [
                [f"{words[kind].format(LIMIT[kind])}: {named({pair: depth})}."] if words else [] for words in said
            ]
            assert [*overlaps({pair: depth}, jaws)] == expected
    back = Plan("V", {JAW: motion_of(dict.fromkeys(AMOUNTS, 0.0) | {"advance": -4.0, "yaw": 3.0}, np.zeros(3))})
    deep, where = jaws.collisions(back)
    assert {"cut"} <= {jaws.kind(*pair) for pair in deep}
    assert bool(len(where)) == any(depth > LIMIT[jaws.kind(*pair)] for pair, depth in deep.items())


def test_a_condyle_out_of_its_place_is_named(patient):
    jaws, turned = Jaws(patient), motion_of(dict.fromkeys(AMOUNTS, 0.0) | {"pitch": 8.0}, Jaws(patient).pivots[RAMI[0]])
    assert jaws.luxated(Plan("V", {RAMI[0]: turned})) == {}
    off = jaws.luxated(Plan("V", {RAMI[0]: motion_of(dict.fromkeys(AMOUNTS, 0.0) | {"advance": 3.0}, np.zeros(3))}))
    assert off == {RAMI[0]: pytest.approx(3)}


def test_a_motion_beyond_practice_is_marked_by_its_part(patient):
    jaws = Jaws(patient)
    far = motion_of(dict.fromkeys(AMOUNTS, 0.0) | {"advance": 10.5, "up": 3.0, "yaw": -7.0}, jaws.middle["lefort1"])
    assert jaws.beyond(Plan("V", {"lefort1": far})) == {"lefort1": ["advance", "yaw"]}
    assert jaws.beyond(Plan("V", {"lefort1": far.fraction(0.5)})) == {}
    assert jaws.beyond(Plan("V", {JAW: far})) == {JAW: ["yaw"]}  # 12 mm of advance are practised there
