"""Editing plans by hand: motions and pivots, undo, two sides, saving; and what is prepared for it."""

from dataclasses import asdict, replace

import numpy as np
import pytest

from pinnochio.errors import InputError
from pinnochio.geometry.rigid import RigidMotion
from pinnochio.importing.segmentation import check_plan
from pinnochio.plans.plan import Plan
from pinnochio.study.patients import read_patients
from studies.planner.prepared import Prepared
from studies.planner.session import REST, SIDES, Session
from tests.helpers.patients import tiny_patient, tiny_plan

PATIENT = tiny_patient()
PLAN = tiny_plan()
MIDDLE = PATIENT.bone_points[PATIENT.bone_segment == 0].mean(axis=0)


@pytest.fixture
def session(tmp_path):
    return Session(PATIENT, "tiny", {"proposed": PLAN}, tmp_path)


def bone(plan):
    return PATIENT.bone_displacement(plan)


def test_a_motion_about_another_pivot_is_the_same_motion():
    motion = RigidMotion.from_degrees([4, -2, 9], [1, 2, 3], [15, -70, 39])
    other = motion.about(np.array([-40.0, 3.0, 8.0]))
    np.testing.assert_allclose(other.apply(PATIENT.points), motion.apply(PATIENT.points), atol=1e-9)
    np.testing.assert_allclose(motion.degrees, [4, -2, 9], atol=1e-9)
    assert other.pivot.tolist() == [-40, 3, 8] and np.linalg.norm(other.translation - motion.translation) > 1


def test_a_session_starts_with_the_proposed_plan_beside_nothing_moved(session):
    assert list(session.plans) == [REST, "proposed"]
    np.testing.assert_allclose(bone(session.drafts["A"].plan), bone(PLAN), atol=1e-9)
    assert not bone(session.drafts["B"].plan).any()
    assert session.values("left") == pytest.approx(
        {"left": 1, "advance": 3, "up": 1.5, "pitch": 2, "roll": 0, "yaw": 0}, abs=1e-9
    )
    assert session.draft.plan.motion("left").pivot.tolist() == [15, -70, 39]
    session.side = "B"
    np.testing.assert_allclose(session.draft.plan.motion("left").pivot, MIDDLE)


def test_a_pivot_far_from_the_bone_is_brought_to_its_middle(tmp_path):
    far = Plan("tiny", {"left": PLAN.motion("left").about(np.array([0.0, 900.0, 0.0]))})
    session = Session(PATIENT, "tiny", {"far": far}, tmp_path)
    np.testing.assert_allclose(session.draft.plan.motion("left").pivot, MIDDLE)
    np.testing.assert_allclose(bone(session.draft.plan), bone(PLAN), atol=1e-9)


def test_one_value_changes_alone_and_a_new_pivot_changes_no_place(session):
    session.change("left", "yaw", -7.5)
    expected = RigidMotion.from_degrees([2, 0, -7.5], [1, -3, 1.5], [15, -70, 39])
    np.testing.assert_allclose(session.draft.plan.motion("left").rotation, expected.rotation, atol=1e-12)
    before = bone(session.draft.plan)
    session.move_pivot("left", [20, -60, 45])
    np.testing.assert_allclose(bone(session.draft.plan), before, atol=1e-9)
    session.change("left", "yaw", 0.0)  # now about the new pivot
    expected = RigidMotion.from_degrees([2, 0, 0], session.draft.plan.motion("left").translation, [20, -60, 45])
    np.testing.assert_allclose(bone(session.draft.plan), bone(Plan("", {"left": expected})), atol=1e-9)


@pytest.mark.parametrize(
    ("method", "arguments"),
    [
        ("choose", ("C",)),
        ("choose", ({"a": 1},)),
        ("open", ("no plan",)),
        ("preset", ("no preset",)),
        ("change", ("right", "up", 1.0)),
        ("change", ("left", "sideways", 1.0)),
        ("stay", ("right",)),
        ("occlude", ()),
        *(("change", ("left", "left", value)) for value in (np.nan, np.inf, 1e308, -51.0, "3", None, True)),
        *(("move_pivot", ("left", [0, *rest])) for rest in ([np.nan, 0], [np.inf, 0], [1e308, 0], [0])),
    ],
)
def test_what_is_not_there_or_no_number_is_said_and_changes_nothing(session, method, arguments):
    before = session.draft.plan
    with pytest.raises((ValueError, TypeError)):
        getattr(session, method)(*arguments)
    assert session.draft.plan is before and session.side == "A" and not session.draft.can_undo


def test_reset_moves_nothing_and_can_be_undone(session):
    before = session.draft.plan
    session.reset()
    assert session.draft.plan.still and not before.still
    session.draft.undo()
    assert session.draft.plan is before


def test_one_pull_of_a_slider_is_one_step_of_undo(session):
    start = session.draft.plan
    for value in (1.5, 2.0, 2.5):
        session.change("left", "left", value)
    session.draft.settle()
    session.change("left", "left", 4.0)
    session.change("left", "up", 0.0)
    seen = []
    while session.draft.can_undo:
        seen.append(session.values("left")["left"])
        session.draft.undo()
    assert seen == pytest.approx([4.0, 4.0, 2.5]) and session.draft.plan is start
    session.draft.undo()
    assert session.draft.plan is start
    session.draft.redo()
    session.draft.redo()
    assert session.values("left")["left"] == pytest.approx(4.0) and session.draft.can_redo
    session.change("left", "left", 9.0)  # after an undo a step of its own, which ends what could be done again
    assert not session.draft.can_redo
    session.draft.undo()
    assert session.values("left")["left"] == pytest.approx(4.0)


def test_each_side_has_a_plan_and_an_undo(session):
    session.change("left", "advance", 9.0)
    session.side = "B"
    assert not session.draft.can_undo
    session.take_other()
    assert session.draft.plan is session.drafts["A"].plan
    session.stay("left")
    assert not bone(session.draft.plan).any() and bone(session.drafts["A"].plan).any()
    session.draft.undo()
    session.draft.undo()
    assert not bone(session.draft.plan).any() and session.drafts["A"].can_undo
    session.open("proposed")
    np.testing.assert_allclose(bone(session.draft.plan), bone(PLAN), atol=1e-9)
    assert {side: draft.can_undo for side, draft in session.drafts.items()} == dict.fromkeys(SIDES, True)


def test_a_saved_plan_reads_back_from_both_forms(session, tmp_path):
    session.change("left", "pitch", 11.0)
    file, folder = session.save("mine")
    assert (file, folder) == (tmp_path / "plans/mine.json", tmp_path / "transforms/mine")
    wanted = bone(session.draft.plan)
    for path in (file, folder):
        np.testing.assert_allclose(bone(Plan.read(path, "tiny")), wanted, atol=1e-6)
    (tmp_path / "segmentation.nii.gz").touch()
    (patient,) = read_patients(tmp_path).values()
    assert patient.plans == {"mine": str(file)}  # so that `snakemake predict` finds it, and finds it once
    session.change("left", "pitch", 3.0)
    session.save("mine")  # one's own plan may be saved again
    session.open("mine")
    np.testing.assert_allclose(bone(Plan.read(file, "tiny")), bone(session.draft.plan), atol=1e-9)
    assert not np.allclose(bone(session.draft.plan), wanted)


REFUSED = {"proposed": "'proposed' already", "there": "'there' already", "../up": "letters, digits"}
REFUSED |= {"": "letters, digits", "a" * 65: "1 to 64 letters"}


@pytest.mark.parametrize("name", REFUSED)
def test_no_other_plan_and_no_other_folder_is_written_to(session, tmp_path, name):
    (tmp_path / "plans").mkdir()
    (tmp_path / "plans/there.json").touch()
    with pytest.raises(InputError, match=REFUSED[name]):
        session.save(name)
    assert [path.name for path in tmp_path.rglob("*.*")] == ["there.json"]


def test_a_plan_that_could_not_be_imported_is_not_saved(session, tmp_path):
    session.change("left", "left", 49.0)
    session.change("left", "up", 30.0)
    with pytest.raises(InputError, match="carries a point of 'left'"):
        session.save("far")
    assert not list(tmp_path.iterdir())


def test_what_is_prepared_reads_back_and_a_missing_file_is_said(tmp_path):
    files = {name: str(tmp_path / name) for name in ("model", "skin", "bone", "quality")}
    for name in (*files, "plan.json"):
        (tmp_path / name).touch()
    plans = {"a": str(tmp_path / "plan.json")}
    empty = {name: {} for name in ("fem", "invert", "scan")}
    files |= empty | {"home": "h", "archive": str(tmp_path), "method": "m"}
    prepared = Prepared("tiny", lift=None, plans=plans, corrections=1, **files)
    prepared.write(tmp_path / "planner.json")
    assert asdict(Prepared.read(tmp_path / "planner.json")) == asdict(prepared)
    (tmp_path / "plan.json").unlink()
    with pytest.raises(InputError, match="plan.json: it is no longer there.*make planner"):
        Prepared.read(tmp_path / "planner.json")
    with pytest.raises(InputError, match="no patient is prepared.*make planner"):
        Prepared.read(tmp_path / "nothing.json")


def test_a_saved_plan_moves_exactly_the_segments_of_its_patient(tmp_path):
    """Whatever is cut, and of whatever plan it starts: what is saved can be imported again."""
    parted = np.where(PATIENT.bone_segment == 0, PATIENT.bone_points[:, 0] > 20, -1).astype(np.int8)
    cut = replace(PATIENT, segments=("mandible", "chin"), bone_segment=parted)
    session = Session(cut, "tiny", {}, tmp_path)
    session.change("chin", "advance", 3.0)
    file, folder = session.save("mine")
    check_plan(Plan.read(file, "tiny"), cut.segments, file)
    check_plan(Plan.read(folder, "tiny"), cut.segments, folder)
    assert session.values("mandible")["advance"] == 0 and session.values("chin")["advance"] == 3
