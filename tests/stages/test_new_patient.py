"""The stages of a new patient on coarse virtual ones: plans, ranges, archive, files, certificate, page."""

import json
import re
import shutil
from dataclasses import asdict, replace
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import pyvista as pv

from pinnochio.columns import read_table
from pinnochio.metrics.validity import OFF_BONE
from pinnochio.model.patient import PatientModel
from pinnochio.model.predictions import Prediction, write_predictions
from pinnochio.model.regions import NAMES, regions
from pinnochio.patients.certificate import in_words
from pinnochio.patients.face_measures import TABLE
from pinnochio.patients.front import within
from pinnochio.patients.model_archive import FALLBACK, Archive, calibration_file
from pinnochio.patients.result import Solution
from pinnochio.plans.plan import Plan, RigidMotion
from pinnochio.plans.surgery import in_words as in_words_of
from pinnochio.statistics.intervals import Calibration, Interval
from scripts.patients.certify import certify
from scripts.patients.export_prediction import export_prediction
from scripts.patients.pack import pack
from scripts.patients.predict_plan import TORN, UNLIKE, compare, predict_plan, torn
from scripts.patients.show_prediction import draw, show_prediction
from tests.helpers.browser import DRIVEN, chromium, uncaught
from tests.helpers.settings import CONFIG, SEGMENTS

METHOD, SLIDING = "pinnochio_plus", "finite_elements:FiniteElementPredictor"
PROCESSOR = {"device": "cpu", "threads": 1}


@pytest.fixture(scope="module")
def archive(training, tmp_path_factory):
    """An archive of two patients and two models (empty files: nothing here runs a network), and their reports."""
    folder = tmp_path_factory.mktemp("archive")
    half_width = {name: 1.5 for name in NAMES}
    Calibration(METHOD, 0.9, 2, 2, half_width, dict.fromkeys(NAMES, 0.1)).write(folder / "calibration.json")
    keys = [(METHOD, fold) for fold in "12"]
    networks = {key: str(folder / f"network_{key[1]}.pt") for key in keys}
    metrics = {key: str(folder / f"metrics_{key[1]}.csv") for key in keys}
    for number, key in enumerate(keys):
        Path(networks[key]).write_bytes(bytes([number]))
        row = {"min_jacobian": 0.2 + number, "eqres_rel": 0.1, "moving_error": 0.3, "sliding_error": np.nan}
        pd.DataFrame([row]).to_csv(metrics[key], index=False)
    about = {"cohort": "virtual cohort", "patients": 2, "segments": list(SEGMENTS), "folds": ["1", "2"]}
    about |= {"settings": {name: CONFIG[name] for name in ("mesh", "fem")}, "configuration": "abc", "code": "def"}
    methods = {METHOD: {"corrections": 1, "lift": "elastic"}}
    calibrations = {METHOD: str(folder / "calibration.json")}
    pack(about, methods, networks, metrics, calibrations, training[0], str(folder / "packed"))
    return folder / "packed", training[1]


@pytest.fixture(scope="module")
def result(patient, tmp_path_factory):
    """A field that carries the face 2 mm forward, with an interval, as a file."""
    model, path = PatientModel.read(patient.model), tmp_path_factory.mktemp("result") / "interval.h5"
    region = regions(model)
    width = np.where(region >= 0, 1.5, np.nan)
    interval = Interval(np.tile([0.0, -2, 0], (len(model.points), 1)), np.zeros(len(model.points)), width, region)
    interval.write(path, **asdict(Solution()))
    return str(path)


def exported(folder):
    """Where the files go that a prediction hands over."""
    skin = [str(folder / f"skin.{kind}") for kind in ("vtp", "ply", "stl")]
    return {"mesh": str(folder / "deformed.vtu"), "skin": skin, "bones": str(folder / "bones")}


def certified(patient, archive, result, folder, learned=True):
    about = {"case": patient.case, "plan": "first", "corrections": 1, "code": "def"}
    about["method"] = METHOD if learned else "fem_sliding"
    packed, path = str(archive[0]) if learned else None, folder / "certificate.json"
    plan, quality = patient.plan, archive[1][0]
    compared = compare(patient.case, patient.model, plan, quality, f"{packed}/ranges.json") if packed else None
    certify(about, patient.model, plan, quality, result, patient.fem, packed, compared, str(path))
    return json.loads(path.read_text())


def by_plan(patient, quality, name, corrections, folder, names, **more):
    """Predict the patient's plan by the method of this name; names: those of the files that it leaves in the folder."""
    predict_plan(
        about={"case": patient.case, "plan": "first", "method": name, "corrections": corrections, "code": "def"},
        planned={"model": patient.model, "plan": patient.plan},
        quality=quality,
        fem=patient.fem,
        lifts=[],
        outputs={key: str(folder / file) for key, file in names.items()} | exported(folder),
        **more,
    )


def test_an_archive_holds_what_prediction_needs(archive):
    folder, _ = archive
    files = {path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file()}
    assert files == {"archive.json", "ranges.json", *(f"{METHOD}/{name}" for name in ("1.pt", "2.pt"))} | {
        f"{METHOD}/calibration.json"
    }
    assert [(folder / METHOD / f"{fold}.pt").read_bytes() for fold in "12"] == [b"\0", b"\1"]
    method = Archive.read(folder).methods[METHOD]
    assert method["usual"] == {"min_jacobian": [0.2, 0.7, 1.2], "eqres_rel": [0.1] * 3, "moving_error": [0.3] * 3}
    assert method["corrections"] == 1


def test_the_files_of_a_prediction(patient, result, tmp_path):
    export_prediction(patient.case, patient.model, patient.plan, result, **exported(tmp_path))
    model = PatientModel.read(patient.model)
    names = {path.relative_to(tmp_path).as_posix() for path in tmp_path.rglob("*.*")}
    assert names == {"deformed.vtu", "skin.vtp", "skin.ply", "skin.stl", "bones/cranium.stl"} | {
        f"bones/{name}.stl" for name in SEGMENTS
    }
    assert np.allclose(pv.read(tmp_path / "deformed.vtu").points, model.points + [0, -2, 0])
    assert np.allclose(pv.read(tmp_path / "skin.ply").points, model.skin_points + [0, -2, 0], atol=1e-4)
    moved, plan = pv.read(tmp_path / "bones/lefort1.stl"), Plan.read(patient.plan, patient.case)
    rest = model.bone_points[model.bone_segment == 0]
    assert np.allclose(moved.points.mean(axis=0), plan.motion("lefort1").apply(rest).mean(axis=0), atol=1e-3)
    still = pv.read(tmp_path / "bones/cranium.stl").points
    assert np.allclose(still.mean(axis=0), model.bone_points[model.bone_segment == -1].mean(axis=0), atol=1e-3)


def test_the_certificate_of_a_patient_of_the_training(patient, archive, result, tmp_path):
    said = certified(patient, archive, result, tmp_path)
    assert said["measures"]["inverted"] == 0 and said["measures"]["min_jacobian"] == pytest.approx(1)
    assert said["measures"]["skin_mean_mm"] == pytest.approx(2) and said["interval"]["median_mm"] == 1.5
    assert said["in_distribution"]["within"] and said["models"]["folds"] == 2
    assert certified(patient, archive, result, tmp_path / "again") == said


def test_seconds_choose_the_method_and_say_first_how_near_it_comes(patient, archive, tmp_path, monkeypatch, capsys):
    elastic, sliding = ({"predictor": f"pinnochio.methods.{name}"} for name in ("elastic:ElasticPredictor", SLIDING))
    rows = [
        {"method": "elastic", "accuracy": "", "times_95": 1},
        {"method": FALLBACK, "accuracy": 0.5, "times_95": 1e9},
    ]
    rows = [row | {"mm": 1 / row["times_95"], "mm_95": 1, "times": 1, "front": True} for row in rows]
    count = len(PatientModel.read(patient.model).points)
    (tmp_path / "front.json").write_text(json.dumps({"nodes": count, "settings": rows}))
    monkeypatch.setattr("scripts.patients.predict_plan.within", partial(within, front=tmp_path / "front.json"))
    names = {"result": "predictions.h5", "certificate": "certificate.json", "page": "index.html", "measures": "m.csv"}
    settings = {"settings": {"fem": vars(patient.fem), "contact": "mucosa"}}
    more = {"networks": {}, "covariates": [], "archive": None, "method": sliding | settings | PROCESSOR}
    more["others"] = {"elastic": elastic | settings, FALLBACK: sliding | settings}
    for seconds, method in ((60, "elastic"), (1e12, FALLBACK)):
        by_plan(patient, archive[1][0], FALLBACK, 0, tmp_path / method, names, seconds=seconds, **more)
        said = json.loads((tmp_path / method / "certificate.json").read_text())
        assert said["method"] == method and said["expected_mm"] == 1 and f": {method}" in capsys.readouterr().out
        assert said["solution"]["solver"] == (method == FALLBACK)


@pytest.mark.parametrize("why", ["unlike", "torn", "nothing"])
def test_finite_elements_stand_in_for_networks(patient, archive, why, tmp_path, monkeypatch):
    """Where patients are unlike the training (the networks here are none: asked, they fail), or tissue is torn."""
    shutil.copytree(archive[0], folder := tmp_path / "packed")
    width = dict.fromkeys(NAMES, 2.5)
    (folder / FALLBACK).mkdir()
    Calibration(FALLBACK, 0.9, 2, 2, width, dict.fromkeys(NAMES, 0.1)).write(folder / calibration_file(FALLBACK))
    ranges = json.loads((folder / "ranges.json").read_text())
    ranges["segments"] = ["chin"] if why == "unlike" else list(SEGMENTS)
    (folder / "ranges.json").write_text(json.dumps(ranges))
    Archive.read(archive[0]).write(folder)
    names = {"result": "interval.h5", "ensemble": "ensemble.h5", "certificate": "certificate.json"}
    names |= {"page": "index.html", "measures": "measures.csv"}
    settings = {"fem": vars(patient.fem), "newton_corrections": 1, "contact": "mucosa"}
    others = {FALLBACK: {"predictor": f"pinnochio.methods.{SLIDING}", "settings": settings}}
    more = {"covariates": [patient.covariates], "archive": str(folder), "others": others}
    more["networks"] = {fold: str(folder / METHOD / f"{fold}.pt") for fold in "12"}
    network = "pinnochio.methods.pinnochio.predictor:GraphPredictor"
    if why == "torn":
        network = "pinnochio.methods.elastic:ElasticPredictor"
        monkeypatch.setattr("scripts.patients.predict_plan.astray", lambda *_: OFF_BONE + 0.1)
    more["method"] = {"predictor": network, "settings": settings} | PROCESSOR
    predict = partial(by_plan, patient, archive[1][0], METHOD, 1, tmp_path, names, **more)
    if why == "nothing":
        with pytest.raises(Exception, match=r"1\.pt"):
            predict()
        return
    predict()
    said = json.loads((tmp_path / "certificate.json").read_text())
    assert (said["method"], said["instead_of"]) == (FALLBACK, METHOD) and said["solution"]["solver"]
    assert said["in_distribution"]["within"] == (why == "torn") and said["interval"]["median_mm"] >= 2.5
    assert said["measures"]["eqres_rel"] < 1e-2
    page = (tmp_path / "index.html").read_text()
    assert f"Sliding FEM</b>: {TORN if why == 'torn' else UNLIKE}" in page
    assert "are like those of the training" not in page
    speaking_against = {row.what for row in in_words(said) if row.good is False or row.bad}
    assert not speaking_against & {"Bone segments", "Anatomy", "Plan", "Muscle layer"}


def test_a_field_is_torn_where_it_leaves_its_bone_or_was_scaled(patient, tmp_path):
    forward = np.tile([0.0, -2, 0], (len(PatientModel.read(patient.model).points), 1))
    for way, damping, expected in ((2, 1.0, False), (9, 1.0, True), (2, 0.5, True)):
        motions = {name: RigidMotion(translation=np.array([0.0, -way, 0])) for name in SEGMENTS}
        Plan(patient.case, motions).write(tmp_path / "plan.json")
        made = {fold: Prediction(forward, repaired=0, damping=damping) for fold in "12"}
        write_predictions(tmp_path / "ensemble.h5", made)
        assert torn(patient.case, str(tmp_path / "ensemble.h5"), patient.model, str(tmp_path / "plan.json")) == expected


def test_a_method_without_training_has_neither_interval_nor_likeness(patient, archive, tmp_path):
    model = PatientModel.read(patient.model)
    result = tmp_path / "predictions.h5"
    write_predictions(result, {patient.case: Prediction(np.zeros_like(model.points))})
    said = certified(patient, archive, str(result), tmp_path, learned=False)
    assert said["interval"] is said["in_distribution"] is said["models"] is None
    assert said["measures"]["eqres_rel"] == 0 and "No interval is calibrated" in str(in_words(said))


def shown(patient, archive, result, folder) -> list[str]:
    """Certificate, measures and page of a result."""
    certified(patient, archive, result, folder)
    drawn = [str(folder / name) for name in ("bones.json", "faces.json")]
    draw(patient.case, patient.model, patient.plan, drawn[0])
    draw(patient.case, patient.model, patient.plan, drawn[1], result)
    files = [str(folder / name) for name in ("certificate.json", "measures.csv", "index.html")]
    show_prediction(patient.case, patient.model, patient.plan, result, files[0], drawn, *files[1:])
    return files


def test_the_page_is_one_file_that_needs_nothing_else(patient, archive, result, tmp_path):
    files = shown(patient, archive, result, tmp_path)
    page = Path(files[2]).read_text()
    sources = re.findall(r'(?:src|href)="(.{0,30})', page)
    assert all(source.startswith("data:") for source in sources)
    assert sum(source.startswith("data:image/png;base64,") for source in sources) == 4
    words = re.sub(r'src="[^"]*"', "", page)
    assert "http" not in words.replace("http://www.w3.org/", "")  # names of SVG
    for said in ("virtual cohort", "For research only", "volume_muscle_cm3", "Not usable.", "SPACE=LPS"):
        assert said in words
    assert "Half-width of the 90 % interval: 90 % of a region&#39;s points should lie this near" in words
    motion = Plan.read(patient.plan, patient.case).motion("lefort1")
    assert f"<td>{in_words_of(motion, 'lefort1')}</td>" in words and "± 90 %" in words
    table = read_table(files[1], TABLE).set_index("name")
    assert table.loc["pogonion_forward", "change"] == 2  # all goes forward, so nothing to anything else
    assert table.loc[["pog_forward", "nasolabial", "upper_lip_e_line", "pogonion_up"], "change"].tolist() == [0] * 4
    assert words.index("Boundary mismatch, moving: ") < words.index("<h2>")  # why not, before all else


@DRIVEN[0]
@DRIVEN[1]
def test_the_page_shows_its_profile_on_a_small_laptop_and_a_phone(patient, archive, result, tmp_path):
    files = shown(patient, archive, result, tmp_path)
    with chromium() as browser:
        for width, height in ((1280, 720), (390, 844)):
            page = browser.new_page(viewport={"width": width, "height": height})
            wrong = uncaught(page)
            page.goto(Path(files[2]).as_uri())
            page.click("summary")
            assert page.evaluate("document.documentElement.scrollWidth") <= width
            assert all(one.bounding_box()["width"] <= width for one in page.locator("table:not(details table)").all())
            drawn, lines = page.locator(".profile svg"), page.locator(".profile svg path")
            box = drawn.bounding_box()
            assert box["x"] >= 0 and box["x"] + box["width"] <= width and box["height"] > 300
            assert lines.count() > 10 and "skin predicted" in drawn.text_content() and not wrong
            rows = page.locator(".profile tr", has_text="Overjet").locator("td").all_inner_texts()
            assert len(rows) == 4 and page.locator("tr", has_text="Lips that cross").count() == 1


def test_a_solve_that_stopped_is_not_usable_and_says_how_far_it_came(patient, archive, tmp_path):
    model = PatientModel.read(patient.model)
    result = tmp_path / "predictions.h5"
    stopped = Prediction(
        np.zeros_like(model.points), converged=False, reason="time limit of 0.001 s reached", iterations=3, load=0.4
    )
    for prediction in (stopped, replace(stopped, converged=True, reason="converged", load=1.0)):
        write_predictions(result, {patient.case: prediction})
        said = certified(patient, archive, str(result), tmp_path, learned=False)
        rows = {row.what: row for row in in_words(said)}
        assert rows["Solver"].bad is not prediction.converged
        assert ("Solver: stopped at 40 % of the plan" in str(said["verdict"])) is not prediction.converged
