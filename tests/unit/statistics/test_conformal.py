"""Conformal half-widths against order statistics and simulated patients; coverage; the interval of a new patient."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pinnochio.columns import check, read_table
from pinnochio.metrics.judged import Judged
from pinnochio.model.measures import MEASURES
from pinnochio.model.postop import PostopSkin
from pinnochio.model.regions import NAMES
from pinnochio.model.truth import TrueMotion
from pinnochio.statistics import intervals as intervals
from pinnochio.statistics.conformal import FACE, HeldOut, coverage, half_width, half_widths, held_out, measures_held_out
from pinnochio.statistics.intervals import Calibration, Interval, interval, skin_spread, usual_spreads
from pinnochio.tables.coverage import COVERAGE, table
from tests.helpers.patients import tiny_patient
from tests.helpers.tables import write
from tests.helpers.virtual_heads import face_alone

LEVEL = 0.9


def simulated(rng, patients: int, between: float, points: int = 40) -> list[np.ndarray]:
    """Errors of exchangeable patients: each has a size of its own, as many points as chance gives it."""
    sizes = np.exp(between * rng.normal(size=patients))
    return [size * np.abs(rng.normal(size=rng.integers(1, 2 * points))) for size in sizes]


def covered(rng, patients: int, between: float, rule, repeats: int = 1500) -> tuple[float, float]:
    """Mean share of new patients' points within rule(errors), and its standard error."""
    shares = []
    for _ in range(repeats):
        *known, new = simulated(rng, patients + 1, between)
        shares.append(np.mean(new <= rule(known)))
    return np.mean(shares), np.std(shares) / np.sqrt(repeats)


# One point each: the classical rank of split conformal prediction.
@given(st.integers(9, 60), st.sampled_from([0.5, 0.8, 0.9]), st.integers(0, 2**32 - 1))
def test_one_point_per_patient_is_split_conformal(patients, level, seed):
    values = np.random.default_rng(seed).random(patients)
    rank = int(np.ceil((patients + 1) * level - 1e-9))
    assert half_width(list(values[:, None]), level) == np.sort(values)[rank - 1]


@pytest.mark.parametrize("level, enough", [(0.9, 9), (0.8, 4), (0.5, 1), (0.95, 19)])
def test_too_few_patients_have_no_finite_half_width(level, enough):
    errors = [np.full(100, 1.0)] * enough
    assert half_width(errors, level) == 1.0
    assert half_width(errors[1:], level) == np.inf
    assert half_width([*errors[1:], np.zeros(0)], level) == np.inf  # a patient without the region is none


def test_patients_weigh_equally_however_many_points_they_have():
    rng = np.random.default_rng(0)
    errors = [rng.random(20) for _ in range(12)]
    repeated = [np.repeat(values, 1 + 50 * (i % 2)) for i, values in enumerate(errors)]
    assert half_width(repeated, LEVEL) == half_width(errors, LEVEL)
    large = [errors[0] + 5, *errors[1:]]
    assert half_width([np.repeat(large[0], 500), *large[1:]], LEVEL) == half_width(large, LEVEL)


@pytest.mark.parametrize("between", [0.0, 0.4, 1.0])
@pytest.mark.parametrize("patients", [9, 32])
def test_new_patients_are_covered_as_often_as_promised(patients, between):
    mean, error = covered(np.random.default_rng(patients), patients, between, lambda known: half_width(known, LEVEL))
    assert LEVEL - 3 * error < mean < LEVEL * (patients + 1) / patients + 3 * error


def test_other_quantiles_are_noticed():
    """Pooling points as if independent, or leaving out the new patient, covers too little where patients differ."""
    rng = np.random.default_rng(1)

    def pooled(known):
        return np.quantile(np.concatenate(known), LEVEL)

    def uncorrected(known):
        return half_width(known, LEVEL * len(known) / (len(known) + 1))

    for rule in (pooled, uncorrected):
        mean, error = covered(rng, 9, 1.5, rule, 3000)
        assert mean < LEVEL - 3 * error


def cohort(rng, patients: int = 40, folds: int = 5, size: float = 1.0) -> list[HeldOut]:
    """Patients whose region r has errors (1 + r) times those of the first; only every second has the last, the neck."""
    scanned = []
    for number in range(patients):
        region = np.repeat(np.arange(len(NAMES) - number % 2), 30).astype(np.int8)
        error = size * (1 + region) * np.abs(rng.normal(size=len(region)))
        scanned.append(HeldOut(f"P{number}", str(number % folds + 1), error, region))
    return scanned


def test_coverage_is_measured_region_by_region():
    rows = coverage(cohort(np.random.default_rng(2)), LEVEL).set_index("region")
    assert list(rows.index) == [*NAMES, FACE]
    assert rows["n"].tolist() == [40] * 7 + [20, 40]
    assert rows["points"].tolist() == [30] * 8 + [225]
    assert rows["coverage_mean"].between(88, 96).all()
    ends = rows[["coverage_low", "coverage_mean", "coverage_high"]].to_numpy()
    assert (np.diff(ends, axis=1) > 0).all()
    widths = rows["half_width"].iloc[:-1]
    assert np.allclose(widths / widths.iloc[0], np.arange(1, 9), rtol=0.15)
    assert np.isnan(rows.loc[FACE, "half_width"])
    assert (rows["half_width_low"] <= rows["half_width_high"]).iloc[:-1].all()


def test_cross_validated_coverage_of_exchangeable_patients_is_the_level():
    rng = np.random.default_rng(7)
    means = []
    for _ in range(25):
        sizes = np.exp(0.5 * rng.normal(size=40))
        patients = [replace(p, error=s * p.error) for p, s in zip(cohort(rng), sizes, strict=True)]
        means.append(coverage(patients, LEVEL).loc[0, "coverage_mean"] / 100)
    error = np.std(means) / np.sqrt(len(means))
    assert LEVEL - 3 * error < np.mean(means) < LEVEL * 33 / 32 + 3 * error


def test_a_fold_is_not_calibrated_on_itself():
    """A fold whose errors are ten times those of the others must turn out uncovered."""
    rng = np.random.default_rng(3)
    patients = [replace(p, error=10 * p.error) if p.fold == "1" else p for p in cohort(rng)]
    inside = [p for p in patients if p.fold == "1"]
    others = [p for p in patients if p.fold != "1"]
    rows = coverage(patients, LEVEL).set_index("region")
    narrow = half_widths(others, LEVEL)
    shares = [100 * np.mean(p.of(0) <= narrow[0]) for p in inside]
    rest = coverage(patients, LEVEL).loc[0, "coverage_mean"] * 40 - np.sum(shares)
    assert np.mean(shares) < 30 < 90 < rest / 32
    assert rows.loc["nose", "coverage_sd"] > 20
    assert rows.loc["nose", "half_width_low"] == narrow[0] < rows.loc["nose", "half_width"]


def test_what_cannot_be_calibrated_stays_empty():
    patients = cohort(np.random.default_rng(4), patients=10)  # 8 in the other folds: one too few
    rows = coverage(patients, LEVEL).set_index("region")
    assert rows["coverage_mean"].isna().all() and rows["half_width_low"].isna().all()
    assert rows.loc["nose", "half_width"] > 0 and np.isnan(rows.loc["neck", "half_width"])
    check(rows.reset_index().assign(method="m"), COVERAGE)


def test_the_table_and_its_twins_show_the_same_numbers(tmp_path):
    frame = coverage(cohort(np.random.default_rng(5)), LEVEL).assign(method="pinnochio_plus")
    write(table(frame, "some cohort"), tmp_path / "coverage.csv")
    read = read_table(tmp_path / "coverage.csv", COVERAGE)
    pd.testing.assert_series_equal(read["half_width"], frame["half_width"].round(3), check_exact=False, atol=1e-9)
    markdown = (tmp_path / "coverage.md").read_text()
    assert f"{frame['coverage_mean'][0]:.2f} ± {frame['coverage_sd'][0]:.2f}" in markdown and "some cohort" in markdown
    assert "upper lip" in (tmp_path / "coverage.html").read_text() and (tmp_path / "coverage.tex").exists()


def test_errors_are_distances_to_triangles_of_the_scan():
    """A flat scan 2 mm above the block's flat skin, which is lifted by half a millimetre at places of either region."""
    patient = flat()
    skin = np.unique(patient.skin_faces)
    high = patient.points[skin, 2].max() + 2
    scan = np.array([[-50, -150, high], [90, -150, high], [90, 0, high], [-50, 0, high]])
    lifted = np.zeros_like(patient.points)
    lifted[:, 2] = 0.5
    places = patient.points[skin] * [0.9, 1, 1] + [2, 0, 0]
    judged = Judged(places, np.zeros(len(places), np.int8), places, np.where(places[:, 0] > 18, 0, -1))
    case = held_out("P", "1", patient, judged, patient.moved_skin(lifted), scan, np.array([[0, 1, 2], [0, 2, 3]]))
    assert 0 < (places[:, 0] > 18).sum() < len(places)
    assert len(case.error) == (places[:, 0] > 18).sum() == len(case.region) and np.allclose(case.error, 1.5)


def flat():
    """The tiny patient with its skin in one plane."""
    patient = tiny_patient()
    points = patient.points.copy()
    top = np.unique(patient.skin_faces)
    points[top, 2] = points[top, 2].max()
    return replace(patient, points=points, skin_points=points)


def test_errors_of_measures_are_those_to_the_truth_or_to_the_scan_about_the_landmarks():
    """A chin 2 mm too far back: by the truth, and by a scan as far in front, which shows nothing sideways."""
    patient = face_alone("class_ii", 3.0)
    still, chin = np.zeros_like(patient.points), patient.points[:, 2] < -50
    went = np.where(chin[:, None], [0.3, -2.0, 0], 0)
    truth = TrueMotion(went, patient.moved_skin(went))
    scan = PostopSkin(patient.moved_skin(went), patient.skin_faces, 0.1)
    known, seen = (measures_held_out("P", "1", patient, still, scan, each) for each in (truth, None))
    by_truth, by_scan = (dict(zip(np.array([*MEASURES])[of.region], of.error, strict=True)) for of in (known, seen))
    assert by_truth["pog_forward"] == pytest.approx(2) and by_truth["chin_asymmetry"] == pytest.approx(0.3)
    assert by_scan["pog_forward"] == pytest.approx(2, abs=0.3) and by_scan["a_forward"] < 0.1
    assert set(by_truth) - set(by_scan) == {"alar_width", "midline", "chin_asymmetry"}


def test_measures_are_covered_each_by_its_half_width():
    rng, units = np.random.default_rng(8), {"one": "mm", "two": "degree"}
    patients = [HeldOut(f"P{n}", str(n % 5 + 1), np.abs(rng.normal(size=2)) * [1, 9], np.arange(2)) for n in range(40)]
    rows = coverage(patients, LEVEL, 0, units, "measures").set_index("region")
    assert list(rows.index) == ["one", "two", "measures"] and rows["n"].tolist() == [40] * 3
    assert rows["coverage_mean"].between(82, 98).all() and rows["unit"].tolist() == ["mm", "degree", "mm, degree"]
    errors = np.array([patient.error for patient in patients])
    assert rows["half_width"][:2].tolist() == np.sort(errors, axis=0)[36].tolist()  # the 37th of 40
    assert np.isnan(rows.loc["measures", "error_mean"]) and rows["error_mean"].iloc[1] == errors[:, 1].mean()


def test_only_disagreement_along_the_normal_widens():
    patient = flat()
    top = np.unique(patient.skin_faces)
    rng = np.random.default_rng(6)
    fields = np.zeros((5, len(patient.points), 3))
    fields[:, :, :2] = 0.3 * rng.normal(size=(5, 1, 2))
    assert np.allclose(skin_spread(patient, fields)[top], 0, atol=1e-12)
    heights = rng.normal(size=5)
    fields[:, :, 2] = heights[:, None]
    assert np.allclose(skin_spread(patient, fields)[top], heights.std(ddof=1))


def test_usual_spread_is_the_root_mean_square_over_patients():
    region = np.array([0, 0, 1, -1], np.int8)
    one = np.array([1.0, 1, 2, 99]), region
    two = np.array([3.0, 3, 9, 99]), np.array([0, 0, 0, -1], np.int8)
    spreads = usual_spreads([one, two])
    assert spreads[0] == pytest.approx(np.sqrt((1 + (9 + 9 + 81) / 3) / 2)) and spreads[1] == 2
    assert np.isnan(spreads[2:]).all()


@pytest.fixture
def calibration():
    widths = {name: 1.0 + code for code, name in enumerate(NAMES)} | {"chin": None}
    return Calibration("pinnochio_plus", LEVEL, 40, 5, widths, dict.fromkeys(NAMES, 0.4) | {"chin": None})


@pytest.fixture
def block(monkeypatch):
    """The flat tiny patient, its skin divided among all regions in turn, and one point not judged."""
    patient = flat()
    codes = (np.arange(len(patient.points)) % len(NAMES)).astype(np.int8)
    codes[np.unique(patient.skin_faces)[0]] = -1
    monkeypatch.setattr(intervals, "regions", lambda model: codes)
    return patient, codes


def models(patient, heights):
    fields = np.zeros((len(heights), len(patient.points), 3))
    fields[:, :, 2] = np.array(heights)[:, None]
    return fields


def test_the_interval_is_the_calibrated_one_where_models_agree(block, calibration):
    patient, codes = block
    result = interval(patient, models(patient, [0.9, 1.0, 1.1]), calibration)
    assert np.allclose(result.displacement, [0, 0, 1]) and np.allclose(result.spread, np.sqrt(0.02 / 3))
    known = (codes >= 0) & (codes != NAMES.index("chin"))
    assert np.array_equal(result.half_width[known], 1.0 + codes[known])
    assert np.isnan(result.half_width[~known]).all() and np.array_equal(result.region, codes)


def test_the_interval_widens_where_models_disagree_and_never_narrows(block, calibration):
    patient, codes = block
    top = np.unique(patient.skin_faces)
    top = top[(codes[top] >= 0) & (codes[top] != NAMES.index("chin"))]
    q = 1.0 + codes[top]
    for spread in (0.0, 0.39, 0.41, 1.0, 3.0):
        width = interval(patient, models(patient, [-spread, 0, spread]), calibration).half_width[top]
        assert (width >= q).all()
        assert np.allclose(width**2 - q**2, 1.6448536**2 * max(0, spread**2 - 0.16))


def test_calibration_and_interval_come_back_from_disk(block, calibration, tmp_path):
    patient, _ = block
    calibration.write(tmp_path / "calibration.json")
    assert Calibration.read(tmp_path / "calibration.json") == calibration
    result = interval(patient, models(patient, [0, 1, 3]), calibration)
    result.write(tmp_path / "interval.h5", case="P", level=LEVEL)
    for name, value in vars(Interval.read(tmp_path / "interval.h5")).items():
        np.testing.assert_array_equal(value, getattr(result, name))
