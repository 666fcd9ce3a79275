"""The planner's forecasts are those of `snakemake predict`, and its picture shows them."""

import json
from pathlib import Path

import numpy as np
import pytest
import torch

from pinnochio.methods.sources import SourceModel
from pinnochio.metrics.quality import quality
from pinnochio.model.patient import PatientModel
from pinnochio.model.regions import NAMES
from pinnochio.networks.building import build
from pinnochio.patients.archive import RANGES, Archive, calibration_file, network_file
from pinnochio.planner.forecast import Forecaster
from pinnochio.planner.prepared import Prepared
from pinnochio.planner.view import View
from pinnochio.plans.plan import Plan
from pinnochio.statistics.intervals import Calibration, Interval
from pinnochio.training.checkpoint import save_network
from scripts.describe_training import describe_training
from scripts.fit import fit
from scripts.make_lift import write_lift
from scripts.predict_ensemble import predict_ensemble
from scripts.predict_interval import predict_interval
from scripts.prepare_planner import prepare_planner
from tests.helpers.settings import CONFIG, SEGMENTS, network_settings

METHOD = "pinnochio_plus"
SMALL = network_settings(
    **(CONFIG["network"] | {"lift": "elastic", "volume_layers": 0, "boundary_layers": 1, "channels": 8})
)


@pytest.fixture(scope="module")
def prepared(patients, tmp_path_factory):
    """The first of two patients, prepared for the planner with an archive of two networks that nobody has trained."""
    patient, folder = patients[0], tmp_path_factory.mktemp("planner")
    reports = []
    for own in patients:
        reports.append(str(folder / f"{own.case}.json"))
        report = quality(PatientModel.read(own.model), json.loads(Path(own.report).read_text()))
        Path(reports[-1]).write_text(json.dumps(report))
    columns = ([getattr(own, name) for own in patients] for name in ("case", "model", "plan"))
    archive = folder / "archive"
    archive.mkdir()
    describe_training(*columns, reports, str(archive / "ranges.json"))
    methods = {METHOD: {"corrections": 1, "lift": "elastic", "usual": {}}}
    Archive("virtual cohort", 2, SEGMENTS, ["1", "2"], methods, {}, "abc", "def").write(archive)
    widths = dict.fromkeys(NAMES, 1.5), dict.fromkeys(NAMES, 0.01)
    Calibration(METHOD, 0.9, 2, 2, *widths).write(archive / calibration_file(METHOD))
    fitted = str(folder / "fitted.h5")
    fit(
        module="pinnochio.methods.fem_learned",
        cases=[own.case for own in patients],
        models=[own.model for own in patients],
        fem_samples=[own.fem_samples for own in patients],
        plans=[own.plan for own in patients],
        postops=[own.postop for own in patients],
        covariates=[own.covariates for own in patients],
        settings={"fem": vars(patient.fem)},
        fitted=fitted,
    )
    sources = {name: torch.as_tensor(value) for name, value in SourceModel.read(fitted).state().items()}
    for number, fold in enumerate("12"):
        torch.manual_seed(number)
        network = build(SMALL)
        with torch.no_grad():
            for weights in network.parameters():  # as built, every network gives out what the lift says
                weights += 0.02 * torch.randn_like(weights)
        save_network(archive / network_file(METHOD, fold), network, SMALL, sources=sources)
    lift = str(folder / "lift.h5")
    write_lift(patient.model, "elastic", 16, patient.fem, lift)
    (folder / "set").mkdir()
    (folder / "set/plan.json").write_text(Path(patient.plan).read_text())
    settings = {"home": str(folder), "archive": str(archive), "method": METHOD, "corrections": 1}
    settings |= {"fem": vars(patient.fem)}
    out = str(folder / "planner.json")
    files = patient.model, lift, patient.covariates, reports[0]
    prepare_planner(patient.case, *files, [str(folder / "set/plan.json")], settings, out)
    return Prepared.read(out)


@pytest.fixture(scope="module")
def forecaster(prepared):
    return Forecaster(prepared, "cpu")


def test_a_forecast_is_the_prediction_of_the_workflow(prepared, forecaster, patient, tmp_path):
    ensemble, result = str(tmp_path / "ensemble.h5"), str(tmp_path / "interval.h5")
    networks = {fold: f"{prepared.archive}/{network_file(METHOD, fold)}" for fold in "12"}
    assert list(prepared.plans) == ["set"]
    plan = prepared.plans["set"]
    predict_ensemble(
        module="pinnochio.methods.pinnochio.predictor",
        settings={"fem": vars(patient.fem), "newton_corrections": 1},
        networks=networks,
        case=prepared.case,
        model=prepared.model,
        plan=plan,
        lift=prepared.lift,
        covariates=prepared.covariates,
        device="cpu",
        threads=1,
        ensemble=ensemble,
    )
    calibration = f"{prepared.archive}/{calibration_file(METHOD)}"
    ranges, picture = f"{prepared.archive}/{RANGES}", str(tmp_path / "p.png")
    about = prepared.case, prepared.model, plan, prepared.quality
    predict_interval(*about, ensemble, calibration, ranges, patient.fem, result, picture)
    expected, forecast = Interval.read(result), forecaster(Plan.read(plan, prepared.case))
    np.testing.assert_allclose(forecast.interval.displacement, expected.displacement, atol=1e-4)
    np.testing.assert_allclose(forecast.interval.half_width, expected.half_width, atol=1e-4)
    assert np.linalg.norm(expected.displacement, axis=1).max() > 3 and forecast.least > 0
    assert np.nanmax(forecast.interval.half_width) > 1.51  # the two networks do not agree


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
    far = Plan(
        prepared.case,
        plan.motions | {"lefort1": type(motion)(motion.rotation, motion.translation + [0, 20, 0], motion.pivot)},
    )
    assert forecaster(far).out_of_distribution == ("plan",)


def test_the_picture_follows_the_plan(prepared, forecaster):
    view, still = View(forecaster.patient, 2.0), forecaster(Plan(prepared.case, {}))
    for side in "AB":
        view.show(side, still)
    view.mark("A", forecaster.patient.skin_points.mean(axis=0))

    def picture(interval=False, bones=False, both=False, side="A"):
        view.compare(both, side)
        view.overlay(interval, bones)
        view.plotter.render()
        return view.plotter.screenshot(return_img=True).astype(int)

    def differ(one, other):
        return (np.abs(one - other).max(axis=2) > 20).mean()

    before = picture()
    marked = picture(both=True)
    halves = np.split(marked, 2, axis=1)
    assert 0.003 < differ(*halves) < 0.03  # pivot and axes on the left alone, in front of the skin
    assert differ(before, picture(interval=True)) > 0.05 and differ(before, picture(bones=True)) > 0.05
    view.show("A", forecaster(Plan.read(prepared.plans["set"], prepared.case)))
    assert differ(before, picture()) > 0.004
    assert differ(halves[1], np.split(picture(both=True), 2, axis=1)[1]) == 0
    view.look("front")
    front = picture(side="B")
    assert differ(front, front[:, ::-1]) < 0.5 * differ(before, before[:, ::-1])  # a face is symmetric
    view.plotter.close()
