"""The planner's forecasts are those of `snakemake predict`, and its picture shows them."""

import numpy as np
import pytest

from pinnochio.geometry.rigid import RigidMotion
from pinnochio.model.measures import MEASURES
from pinnochio.model.patient import PatientModel
from pinnochio.patients.face_measures import FaceMeasures
from pinnochio.patients.in_distribution import widening
from pinnochio.patients.model_archive import RANGES, calibration_file, network_file
from pinnochio.plans.plan import Plan
from pinnochio.statistics.intervals import Interval
from scripts.patients.predict_plan import compare
from scripts.prediction.predict_interval import predict_interval
from studies.inverse.wish import Marks
from studies.planner.forecast import Forecaster
from studies.planner.view import FaceView
from studies.planner.wishing import Wishing
from tests.helpers.settings import CONFIG
from tests.helpers.training import predict_all

METHOD = "pinnochio_plus"


@pytest.fixture(scope="module")
def forecaster(prepared):
    return Forecaster(prepared, "cpu")


def test_a_forecast_is_the_prediction_of_the_workflow(prepared, forecaster, patient, tmp_path):
    ensemble, result = str(tmp_path / "ensemble.h5"), str(tmp_path / "interval.h5")
    networks = {fold: f"{prepared.archive}/{network_file(METHOD, fold)}" for fold in "12"}
    assert list(prepared.plans) == ["set"]
    plan = prepared.plans["set"]
    predict_all(networks, prepared, ensemble, 1, plan, prepared.lift)
    calibration = f"{prepared.archive}/{calibration_file(METHOD)}"
    ranges = f"{prepared.archive}/{RANGES}"
    factor = widening(compare(prepared.case, prepared.model, plan, prepared.quality, ranges))
    predict_interval(prepared.case, prepared.model, ensemble, calibration, factor, patient.fem, result)
    expected, forecast = Interval.read(result), forecaster(Plan.read(plan, prepared.case))
    # But for elements that are repaired, to the precision of that.
    np.testing.assert_allclose(forecast.interval.displacement, expected.displacement, atol=0.02)
    np.testing.assert_allclose(forecast.interval.half_width, expected.half_width, atol=0.01)
    assert np.linalg.norm(expected.displacement, axis=1).max() > 3 and forecast.least > 0
    assert np.nanmax(forecast.interval.half_width) > 1.51  # the two networks do not agree


def test_a_plan_that_moves_nothing_moves_the_face_by_exactly_nothing(prepared, forecaster):
    patient = forecaster.patient
    little = RigidMotion(translation=np.array([0.0, -0.5, 0]))
    assert forecaster(Plan(prepared.case, {"lefort1": little})).mean > 0  # the networks do move it
    for motions in ({}, {"lefort1": RigidMotion(pivot=np.array([3.0, -40, 7])), "mandible_distal": RigidMotion()}):
        for forecast in filter(None, forecaster.steps(Plan(prepared.case, motions))):
            assert not forecast.interval.displacement.any() and forecast.mean == forecast.most == 0
            np.testing.assert_array_equal(forecast.skin, patient.skin_points)
    rows = FaceMeasures(patient).rows(forecast.interval.displacement)
    assert all(row.change == 0 for row in rows if np.isfinite(row.change)) and len(rows) > 20


def test_a_first_look_comes_before_the_corrections_and_shows_nearly_the_same(prepared, forecaster):
    plan = Plan.read(prepared.plans["set"], prepared.case)
    first, *between, last = forecaster.steps(plan)
    assert first.least is None and between == [None, None] and last.least is not None
    assert first.seconds < last.seconds and first.plan is last.plan is plan
    difference = np.linalg.norm(first.skin - last.skin, axis=1)
    moved = np.linalg.norm(last.skin - forecaster.patient.skin_points, axis=1)
    assert 0 < difference.mean() < 0.2 * moved.mean()


def test_a_plan_unlike_the_training_is_said(prepared, forecaster):
    plan = Plan.read(prepared.plans["set"], prepared.case)
    assert forecaster(plan).out_of_distribution == ()
    motion = plan.motion("lefort1")
    far = type(motion)(motion.rotation, motion.translation + [0, 60, 0], motion.pivot)
    forecast = forecaster(Plan(prepared.case, plan.motions | {"lefort1": far}))
    assert forecast.out_of_distribution == ("plan",) and forecast.out_of_range


def test_the_picture_follows_the_plan(prepared, forecaster):
    scan = forecaster.patient.skin_points + [0, -3.0, 0], forecaster.patient.skin_faces
    view, still = FaceView(forecaster.patient, 2.0, 0.0, scan), forecaster(Plan(prepared.case, {}))
    nowhere = np.zeros((0, 3))
    for side in "AB":
        view.show(side, still, nowhere)
    view.mark("A", forecaster.patient.skin_points.mean(axis=0))

    def picture(coloured="none", shown=(), both=False, side="A"):
        view.compare(both, side)
        view.overlay(coloured, shown)
        view.plotter.render()
        return view.plotter.screenshot(return_img=True).astype(int)

    def differ(one, other):
        return (np.abs(one - other).max(axis=2) > 20).mean()

    before = picture()
    marked = picture(both=True)
    halves = np.split(marked, 2, axis=1)
    assert 0.003 < differ(*halves) < 0.03  # pivot and axes on the left alone, in front of the skin
    interval, displacement = picture("interval"), picture("displacement")
    assert differ(before, interval) > 0.05 and differ(before, displacement) > 0.05
    assert differ(interval, displacement) > 0.05  # what does not move is dark, what is uncertain is bright
    assert differ(before, picture(shown=["bones"])) > 0.05 and differ(before, picture(shown=["scan"])) > 0.05
    assert differ(before, picture(shown=["profile"])) > 0.001 and differ(before, picture(shown=["midline"])) > 0.001
    assert differ(before, picture(shown=["ghost"])) < 0.05  # it lies in the skin
    planned = forecaster(Plan.read(prepared.plans["set"], prepared.case))
    view.show("A", planned, forecaster.patient.skin_points[::50])
    collided = picture()
    view.show("A", planned, nowhere)
    assert differ(collided, picture()) > 0.001
    assert differ(before, picture()) > 0.004 and differ(displacement, picture("displacement")) > 0.02
    assert differ(picture(), picture(shown=["ghost"])) > 0.004
    assert differ(halves[1], np.split(picture(both=True), 2, axis=1)[1]) == 0
    view.look("front")
    front = picture(side="B")
    assert differ(front, front[:, ::-1]) < 0.5 * differ(before, before[:, ::-1])  # a face is symmetric
    view.plotter.close()


def test_a_wish_is_fitted_at_once_and_then_by_finite_elements(patient, monkeypatch):
    for place in ("solvers.kept_factors", "simulation"):  # kept factors leave nothing to Newton's method
        monkeypatch.setattr(f"pinnochio.mechanics.{place}.solve", None)
    model = PatientModel.read(patient.model)
    wishing, measure = Wishing(model, patient.case, patient.fem, CONFIG["invert"]), MEASURES["pog_forward"]
    now = measure.rule(Marks.of(model).chosen(measure.points).rest)[0]
    operation = wishing.operations[0]
    fits = list(wishing.fits({"pog_forward": now + 3}, operation))
    assert [fit.verified for fit in fits] == [False, True]
    assert all(fit.missed["pog_forward"] <= fit.met for fit in fits)
    assert not fits[1].plan.still and set(fits[1].plan.motions) <= set(model.segments)
    with pytest.raises(ValueError, match=r"wished to be .*\. Wish a change of 25 mm or less"):
        wishing.wish("pog_forward", now + 400)
    for wishes, name, words in (({}, operation, "nothing is wished"), ({"pog_forward": now}, "eyes", "no operation")):
        with pytest.raises(ValueError, match=words):
            list(wishing.fits(wishes, name))
