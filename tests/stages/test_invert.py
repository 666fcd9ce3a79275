"""From a wish to a plan on a coarse head: motions that made a face are found, and bad wishes are refused."""

import json
from dataclasses import replace

import numpy as np
import pytest

from pinnochio.columns import read_table
from pinnochio.errors import InputError
from pinnochio.model.measures import MEASURES
from pinnochio.model.patient import PatientModel
from pinnochio.model.surfaces import write_surface
from pinnochio.plans.plan import Plan
from pinnochio.statistics.intervals import Calibration
from studies.inverse.alternatives import answers, contradictions
from studies.inverse.columns import RECOVERED
from studies.inverse.elastic_face import ElasticFace
from studies.inverse.freedom import freedom
from studies.inverse.measure_inverse import EXACT, apart, measure_inverse
from studies.inverse.proposal import InverseSettings
from studies.inverse.propose import propose_plans
from studies.inverse.reading import read_wish
from studies.inverse.wish import Marks, MeasureWish, PlaceWish, SurfaceWish, stacked
from studies.inverse.wish_columns import COMBINATIONS, MOTIONS, PROPOSALS, REACHED
from tests.helpers.settings import CONFIG

INVERT = CONFIG["invert"]
SETTINGS = InverseSettings.of(INVERT)


@pytest.fixture(scope="module")
def model(patient):
    return PatientModel.read(patient.model)


@pytest.fixture(scope="module")
def face(patient, model):
    elastic = ElasticFace(model, patient.fem)
    yield elastic
    elastic.close()


@pytest.fixture(scope="module")
def free(model):
    return freedom(model, "two_jaw", INVERT["bounds"])


@pytest.fixture(scope="module")
def made(patient, face, free):
    """A plan that the bounds admit, and its finite-element field."""
    plan = free.plan(patient.case, free.nearest(Plan.read(patient.plan, patient.case)))
    return plan, face.solve(plan).displacement


def markups(path, points, frame="LPS", unit="mm"):
    turn = [-1, -1, 1] if frame == "RAS" else [1, 1, 1]
    listed = [{"label": name, "position": (np.array(place) * turn).tolist()} for name, place in points.items()]
    content = {"type": "Fiducial", "coordinateSystem": frame, "coordinateUnits": unit, "controlPoints": listed}
    path.write_text(json.dumps({"markups": [content]}))
    return str(path)


def answered(face, wish, case, operation="two_jaw", settings=SETTINGS, **bounds):
    return answers(face, wish, [operation], INVERT["bounds"] | bounds, settings, case)[operation]


def test_the_derivative_of_every_wish_is_that_of_its_residual(model, made):
    marks = Marks.of(model)
    read = MEASURES["nasolabial"]
    wishes = [
        PlaceWish("pogonion", marks.chosen(["pogonion"]), np.zeros(3), 2.0),
        MeasureWish("nasolabial", marks.chosen(read.points), read, 100.0, 0.5),
    ]
    rng = np.random.default_rng(0)
    for wish in wishes:
        step = 1e-4 * rng.normal(size=model.points.shape)
        change = wish.rows(made[1] + step)[0] - wish.rows(made[1] - step)[0]
        np.testing.assert_allclose(2 * wish.rows(made[1])[1] @ step.ravel(), change, rtol=1e-3, atol=1e-7)
    residual, rows = stacked(wishes, made[1])
    assert rows.shape == (4, 3 * len(model.points))
    mean = (2 * wishes[0].error(made[1]) ** 2 + 0.5 * wishes[1].error(made[1]) ** 2) / 2.5
    assert residual @ residual == pytest.approx(mean)


def test_a_surface_is_met_by_itself_and_missed_by_as_much_as_it_is_moved(model):
    rest = np.zeros_like(model.points)
    assert SurfaceWish.of("own", model, model.skin_points, model.skin_faces).error(rest) < 1e-9
    normals = SurfaceWish.of("own", model, model.skin_points, model.skin_faces).normals
    swollen = SurfaceWish.of("swollen", model, model.skin_points + 0.1 * normals, model.skin_faces)
    assert swollen.error(rest) == pytest.approx(0.1, abs=0.01)
    assert np.nanmedian(swollen.distances(rest)) == pytest.approx(-0.1, abs=0.01)
    (residual, rows), before = swollen.rows(rest), swollen.distances(rest)
    shift = np.tile([0.0, -0.05, 0], (len(model.points), 1))
    over = np.flatnonzero(np.isfinite(before))
    change = (swollen.distances(shift) - before)[over]
    expected = (rows @ shift.ravel()) / (residual / before[over])
    assert np.nanmedian(np.abs(change)) > 0.02 and np.nanmedian(np.abs(change - expected)) < 2e-3


def test_a_surface_gives_back_the_motion_that_made_it(patient, model, face, made):
    plan, field = made
    wish = [SurfaceWish.of("face", model, model.moved_skin(field), model.skin_faces)]
    answer = answered(face, wish, patient.case, settings=replace(SETTINGS, tolerance=EXACT))
    assert answer.proposal.solved and answer.proposal.misfit < 0.02
    usual = answered(face, wish, patient.case)
    assert usual.proposal.misfit < SETTINGS.tolerance + 0.02
    size = [np.linalg.norm(one.freedom.lever * one.proposal.x) for one in (answer, usual)]
    assert size[1] < size[0]
    for index, name in enumerate(model.segments):
        bone = model.bone_points[model.bone_segment == index]
        error, degrees = apart(answer.proposal.plan.motion(name), plan.motion(name), bone)
        assert error < 0.2 and degrees < 0.3, name


def test_landmarks_are_reached_and_what_they_cannot_tell_is_said(patient, model, face, made):
    marks = Marks.of(model).chosen(["pogonion", "labrale_superius"])
    targets = marks.moved(made[1])
    wish = [
        PlaceWish(name, marks.chosen([name]), target, 1.0) for name, target in zip(marks.names, targets, strict=True)
    ]
    answer = answered(face, wish, patient.case)
    assert all(one.error(answer.proposal.displacement) < 0.2 for one in wish)
    hidden = answer.combinations.hidden
    assert hidden.sum() >= len(hidden) - 6  # two points say six numbers
    x, change = answer.proposal.x, answer.combinations.directions[0]
    fields = [face.elastic(answer.freedom.amplitudes(x + share * change)) for share in (0, 1)]
    assert np.abs(marks.moved(fields[1]) - marks.moved(fields[0])).max() < 0.2
    # Least motion among equals: no more than what made the face.
    lever = answer.freedom.lever
    assert np.linalg.norm(lever * x) < 1.05 * np.linalg.norm(lever * answer.freedom.nearest(made[0]))


def test_bounds_hold_and_what_lies_beyond_them_is_not_reached(patient, model, face):
    marks = Marks.of(model).chosen(["pogonion"])
    wish = [PlaceWish("pogonion", marks, marks.rest[0] + [0, -9, 0], 1.0)]
    tight = INVERT["bounds"]["mandible"] | {"forward": [-1, 2]}
    answer = answered(face, wish, patient.case, "mandible", mandible=tight)
    assert answer.proposal.plan.motion("mandible_distal").translation[1] > -12
    assert ("mandible_distal", "forward") in answer.proposal.at_bounds
    assert wish[0].error(answer.proposal.displacement) > 3


def test_two_wishes_that_contradict_each_other_are_named(model, face, free):
    marks = Marks.of(model).chosen(["pogonion"])
    there, here = marks.rest[0] + [0, -4, 0], marks.rest[0] + [0, 3, 0]
    wish = [PlaceWish("one", marks, there, 1.0), PlaceWish("other", marks, here, 1.0)]
    ((one, other, error),) = contradictions(face, wish, free, SETTINGS)
    assert (one, other) == ("one", "other") and error == pytest.approx(3.5, abs=0.2)
    assert contradictions(face, wish[:1], free, SETTINGS) == []


def test_wishes_are_read_from_markups_surfaces_and_measures(patient, model, tmp_path):
    marks = Marks.of(model).chosen(["pogonion", "subnasale"])
    wished, older = {"Pog'": marks.rest[0] + [0, -3, 0]}, tmp_path / "wish_nose.fcsv"
    older.write_text("# columns = id,x,y,z,label\n1,{},{},{},Sn\n".format(*(marks.rest[1] + [0, -1, 0]) * [-1, -1, 1]))
    write_surface(model.skin_points, model.skin_faces, tmp_path / "wish.ply")
    (tmp_path / "wish.csv").write_text("measure,value,change,weight\nnasolabial,105,,2\npog_forward,,+4,\n")
    files = [markups(tmp_path / "wish.mrk.json", wished, "RAS"), older, tmp_path / "wish.ply", tmp_path / "wish.csv"]
    read = read_wish(files, model, INVERT["weights"], patient.case)
    assert [measure.name for measure in read] == ["pogonion", "subnasale", "wish.ply", "nasolabial", "pog_forward"]
    np.testing.assert_allclose([read[0].target, read[1].target], [wished["Pog'"], marks.rest[1] + [0, -1, 0]])
    assert read[3].target == 105 and read[3].weight == 2
    rest = np.zeros_like(model.points)
    assert read[4].error(rest) == pytest.approx(4) and read[2].error(rest) < 1e-3
    file = markups(tmp_path / "mine.mrk.json", {"mole": model.skin_points[model.judged_points[0]]})
    wish = markups(tmp_path / "wish_mole.mrk.json", {"mole": model.skin_points[model.judged_points[0]] + [0, -1.0, 0]})
    (mole,) = read_wish([wish], model, INVERT["weights"], patient.case, [file])
    assert mole.error(rest) == pytest.approx(1)


@pytest.mark.parametrize(
    ("points", "frame", "unit", "said"),
    [
        ({"Pog'": (0, -3, 0)}, "mirrored", "mm", "RAS instead of LPS"),
        ({"Pog'": (0, -3, 0)}, "metres", "mm", "metres"),
        ({"Pog'": (0, -90, 0)}, "LPS", "mm", "90 mm away"),
        ({"Pogg'": (0, -3, 0)}, "LPS", "mm", 'did you mean "pog\'"'),
        ({"Pog'": (0, -3, 0), "pogonion": (0, 1, 0)}, "LPS", "mm", "two places"),
        ({"Pog'": (0, -3, 0)}, "LPS", "cm", "its unit is 'cm'"),
        ({}, "LPS", "mm", "no point"),
    ],
)
def test_a_wish_that_cannot_be_meant_is_refused(patient, model, tmp_path, points, frame, unit, said):
    start = Marks.of(model).chosen(["pogonion"]).rest[0]
    factor = {"mirrored": np.array([-1.0, -1, 1]), "metres": 0.001}.get(frame, 1.0)
    wished = {name: (start + off) * factor for name, off in points.items()}
    file = markups(tmp_path / "wish.mrk.json", wished, "LPS", unit)
    with pytest.raises(InputError, match=said):
        read_wish([file], model, INVERT["weights"], patient.case)


def test_a_landmark_that_is_marked_off_the_face_is_refused(patient, model, tmp_path):
    off = model.points.mean(axis=0) + [0, 60, 0]
    mine, wish = (markups(tmp_path / f"{name}.mrk.json", {"mole": off}) for name in ("mine", "wish"))
    with pytest.raises(InputError, match="off the face"):
        read_wish([wish], model, INVERT["weights"], patient.case, [mine])


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("measure,value,change\nnasolabal,105,\n", "did you mean 'nasolabial'"),
        ("measure,value,change\nnasolabial,105,3\n", "both value and change"),
        ("measure,value,change\nnasolabial,,\n", "neither value and change"),
        ("measure,value,change\nnasolabial,wide,\n", "value of 'nasolabial' is 'wide'"),
        ("measure,value,change\npog_forward,,60\n", "wished to be"),
        ("measure,value,weight\nnasolabial,105,0\n", "weight of 'nasolabial' is 0"),
        ("measure,value,weight\nnasolabial,105,1e300\n", "weight of 'nasolabial' is 1e"),
        ("measure,value\nnasolabial,1_05\n", "value of 'nasolabial' is '1_05'"),
        ("measure,value\nnasolabial,105\nalar_width,3,5\n", "line 3 has 3 cells, the first line 2"),
        ("measure,value,value\nnasolabial,105,108\n", "its columns are .*each once"),
        ("measures,value\nnasolabial,105\n", "its columns are"),
        ("measure,value,change\nmidline,0,\nmidline,1,\n", "wished twice"),
    ],
)
def test_a_table_of_measures_that_says_nothing_sure_is_refused(patient, model, tmp_path, text, said):
    (tmp_path / "wish.csv").write_text(text)
    with pytest.raises(InputError, match=said):
        read_wish([str(tmp_path / "wish.csv")], model, INVERT["weights"], patient.case)


@pytest.mark.parametrize(
    ("turn", "shift", "said"),
    [
        ([-1, -1, 1], [0, 0, 0], "RAS instead of LPS"),
        ([1, 1, 1], [0, 0, 400.0], "nowhere|mm away"),
        ([1, 1, 1], [0, -60.0, 0], "mm away"),
    ],
)
def test_a_surface_elsewhere_is_refused(patient, model, tmp_path, turn, shift, said):
    write_surface(np.array(turn) * model.skin_points + shift, model.skin_faces, tmp_path / "wish.stl")
    with pytest.raises(InputError, match=said):
        read_wish([str(tmp_path / "wish.stl")], model, INVERT["weights"], patient.case)


def test_the_stage_writes_plans_that_read_back_and_a_page(patient, model, made, tmp_path):
    marks = Marks.of(model).chosen(["pogonion", "labrale_superius"])
    wish = markups(tmp_path / "wish.mrk.json", dict(zip(marks.names, marks.moved(made[1]), strict=True)), "RAS")
    kinds = {"proposals": PROPOSALS, "reached": REACHED, "motions": MOTIONS, "combinations": COMBINATIONS}
    out = {name: str(tmp_path / f"{name}.csv") for name in kinds}
    out |= {name: str(tmp_path / name) for name in ("plans", "transforms")} | {"page": str(tmp_path / "index.html")}
    settings = INVERT | {"operations": ["two_jaw_chin", "two_jaw", "mandible"]}
    known = {"nose": 1.0, "upper_lip": 2.5, "chin": None}
    calibration = Calibration("fem_sliding", 0.9, 9, 1, known, known)
    calibration.write(tmp_path / "calibration.json")
    files = [wish], [], None, str(tmp_path / "calibration.json")
    propose_plans(patient.case, patient.model, *files, patient.fem, settings, "code", out)
    tables = {name: read_table(out[name], columns) for name, columns in kinds.items()}
    assert tables["proposals"]["operation"].tolist() == ["two_jaw", "mandible"]  # there is no chin
    assert tables["proposals"]["reached"][0] and tables["proposals"]["solved"].all()
    widths = tables["reached"].set_index("wish")["half_width"]
    assert (widths["labrale_superius"] == 2.5).all() and widths["pogonion"].isna().all()
    assert set(tables["motions"]["segment"]) == set(model.segments)
    for name in ("two_jaw", "mandible"):
        plan = Plan.read(f"{out['plans']}/{name}.json", patient.case)
        again = Plan.read(f"{out['transforms']}/{name}", patient.case)
        for segment in plan.motions:
            points = model.bone_points[model.bone_segment == model.segments.index(segment)]
            places = [one.motion(segment).apply(points) for one in (plan, again)]
            np.testing.assert_allclose(*places, atol=1e-6)
    text = (tmp_path / "index.html").read_text(encoding="utf-8")
    assert "both jaws" in text and "labrale superius" in text and text.count("<img") == 2


@pytest.mark.full
def test_the_motion_of_an_outcome_is_sought(patient, tmp_path):
    truth, out = (patient.executed, patient.postop, patient.truth), tmp_path / "recovered.csv"
    measure_inverse(patient.case, patient.model, patient.plan, *truth, patient.fem, INVERT, "code", str(out))
    rows = read_table(out, RECOVERED).set_index(["task", "tolerance"])["error"]
    assert rows.loc[("simulated", EXACT)].max() < 0.3 < rows.loc["outcome"].max()
    assert len(rows) == 4 * len(rows.loc["landmarks"])
