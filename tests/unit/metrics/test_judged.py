"""What a case is judged by: chosen once, where the face went and not where a method takes it."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial import cKDTree

from pinnochio.errors import InputError
from pinnochio.geometry.alignment import carried
from pinnochio.geometry.closest_points import closest_points
from pinnochio.metrics.evaluation import CaseJudge
from pinnochio.metrics.judged import Judged, choose
from pinnochio.model.landmarks import face_landmarks
from pinnochio.model.predictions import Prediction
from pinnochio.model.regions import LOWER_LIP, NAMES, NECK, UPPER_LIP, jaw_plane, regions
from pinnochio.plans.plan import Plan, RigidMotion
from tests.helpers.patients import tiny_patient
from tests.helpers.settings import fem_settings
from tests.helpers.virtual_heads import face_alone

UNKNOWN = Plan("P1", {})  # says nothing of where the jaws have gone
WAY = np.array([1.0, -8.0, -6.0])  # of the lower face, 10 mm


@pytest.fixture(scope="module")
def patient():
    return face_alone("class_ii")


@pytest.fixture(scope="module")
def codes(patient):
    return regions(patient)


@pytest.fixture(scope="module")
def outcome(patient):
    """The skin with the lower face 10 mm ahead and below, the upper lip half of it ahead, the upper face as it was."""
    marks = face_landmarks(patient)
    heights = [marks.stomion[2] - 6, marks.stomion[2] + 2, marks.sellion[2]]
    share = np.interp(patient.skin_points[:, 2], heights, [1, 0.5, 0])
    behind = np.interp(patient.skin_points[:, 1], [marks.menton[1] + 20, marks.menton[1] + 60], [1, 0])
    return patient.skin_points + (share * behind)[:, None] * WAY


@pytest.fixture(scope="module")
def seen(patient, outcome):
    """Its scan: the front alone, with a hole in a cheek and noise."""
    centre = outcome[patient.skin_faces].mean(axis=1)
    front = centre[:, 1] < np.quantile(centre[:, 1], 0.7)
    hole = np.linalg.norm(centre - centre[front][np.argmin(centre[front][:, 0])], axis=1) < 12
    noise = 0.2 * np.random.default_rng(0).normal(size=outcome.shape)
    return outcome + noise, patient.skin_faces[front & ~hole]


@pytest.fixture(scope="module")
def judged(patient, seen):
    return choose(patient, UNKNOWN, *seen, 4000, 1)


def row(patient, moved, seen, judged):
    labels = {"fold": "1", "method": "m", "code": "c", "registration_residual": 0.2}
    prediction = Prediction(None, skin=moved - patient.skin_points)
    common = {"fem": fem_settings(), "seed": 1, "target": seen, "judged": judged, "labels": labels}
    return CaseJudge(patient, **common).row(UNKNOWN, prediction)


def test_a_jaw_that_moved_by_10_mm_keeps_its_regions(patient, codes, outcome, seen, judged):
    """Where each sample truly came from is known here; without the alignment a lip is taken for the other one."""
    true = codes[cKDTree(outcome).query(judged.target)[1]]
    assert (judged.target_region == true).mean() > 0.95
    still = codes[cKDTree(patient.skin_points).query(judged.target)[1]]
    for lip in (UPPER_LIP, LOWER_LIP):
        of_lip = true == lip
        assert of_lip.sum() > 20
        assert (judged.target_region[of_lip] == lip).mean() > max(0.8, (still[of_lip] == lip).mean() + 0.1), NAMES[lip]


def test_the_plan_begins_the_search_and_does_not_end_it(patient, outcome, seen, judged):
    """Told 3 mm more than happened, or nothing, nearly every sample falls where it does when told what did."""
    whole = {"lefort1": 0.5, "mandible_distal": 1.0}
    for error in (1.0, 1.3):
        motions = {name: RigidMotion(translation=error * share * WAY) for name, share in whole.items()}
        one = choose(patient, Plan("P1", motions), *seen, 4000, 1)
        assert abs(len(one.target) / len(judged.target) - 1) < 0.02
        assert np.mean(one.target_region[cKDTree(one.target).query(judged.target)[1]] == judged.target_region) > 0.97


def test_a_skin_that_is_carried_lies_on_the_scan(patient, outcome, seen):
    moved = carried(patient.skin_points, patient.skin_faces, *seen, patient.face_roi, patient.skin_points, 1)
    closest = closest_points(moved[patient.judged_points], *seen)
    assert np.mean(closest.distance[~closest.border]) < 0.3
    away = np.linalg.norm(moved - outcome, axis=1)[patient.judged_points]
    assert away.mean() < 1.6 < 4 < np.linalg.norm(patient.skin_points - outcome, axis=1)[patient.judged_points].max()


def test_what_a_scan_does_not_show_is_judged_by_neither_surface(outcome, seen, judged, patient):
    """No sample of the skin falls into the hole, however near to its edge a method may take it later."""
    true = outcome[cKDTree(patient.skin_points).query(judged.skin)[1]]
    assert np.quantile(cKDTree(seen[0][np.unique(seen[1])]).query(true)[0], 0.99) < 4
    assert 0.5 * 4000 < len(judged.skin) < 4000 and 0.5 * 4000 < len(judged.target) < 2 * 4000


def test_the_neck_is_seen_and_counts_nowhere(patient, codes, outcome, seen, judged):
    """What a prediction does with the neck is in the neck's columns alone."""
    assert NECK not in judged.skin_region and NECK not in judged.target_region and len(judged.neck) > 200
    assert (codes[cKDTree(outcome).query(judged.neck)[1]] == NECK).mean() > 0.95
    wrong = outcome.copy()
    menton, down = jaw_plane(patient, face_landmarks(patient))
    wrong[(patient.skin_points - menton) @ down > 5] += [0, 30.0, 0]
    one, other = row(patient, outcome, seen, judged), row(patient, wrong, seen, judged)
    assert other["region_neck"] > 1.5 > 0.5 > one["region_neck"] and other["bias_neck"] < -1
    for name in ("cd", "hd95", "hdmax", "p99", "pwr1", "pwr2", "region_chin"):
        assert other[name] == pytest.approx(one[name], abs=0.05)


def test_all_methods_have_the_same_samples_and_a_shift_along_the_skin_drops_none(patient, outcome, seen, judged):
    rows = [row(patient, moved, seen, judged) for moved in (outcome, outcome + [6.0, 0, 0], patient.skin_points)]
    assert len({(made["target_samples"], made["skin_samples"]) for made in rows}) == 1
    exact, shifted, still = (made["cd"] for made in rows)
    assert exact < 0.3 and exact < shifted and exact < still


def test_a_lip_that_shrinks_cannot_drop_its_worst_samples(patient, codes, outcome, seen, judged):
    """The farther a prediction draws the lip back, the larger its error, by samples that stay."""
    lip = codes == LOWER_LIP
    errors = []
    for share in (0.0, 0.3, 0.6, 1.0):
        moved = outcome.copy()
        low = moved[lip, 2].min()
        moved[lip, 2] -= 0.7 * share * (moved[lip, 2] - low)
        moved[lip, 1] += 5 * share
        errors.append(row(patient, moved, seen, judged))
    assert len({made["target_samples"] for made in errors}) == 1
    assert np.all(np.diff([made["region_lower_lip"] for made in errors]) > 0.3)
    assert errors[-1]["hdmax"] > 4


def test_samples_are_carried_by_the_skin_that_they_lie_on(patient, judged):
    assert np.allclose(judged.before(patient).carried(patient.skin_points), judged.skin, atol=1e-6)
    turned = patient.skin_points @ np.diag([1, 1.1, 0.9]) + [1, 2, 3]
    assert np.allclose(
        judged.before(patient).carried(turned), judged.skin @ np.diag([1, 1.1, 0.9]) + [1, 2, 3], atol=1e-6
    )


def test_the_choice_is_its_seed_and_is_stored(patient, seen, judged, tmp_path):
    judged.write(tmp_path / "judged.h5")
    again, other = choose(patient, UNKNOWN, *seen, 4000, 1), choose(patient, UNKNOWN, *seen, 4000, 2)
    for name, value in vars(Judged.read(tmp_path / "judged.h5")).items():
        assert np.array_equal(value, getattr(judged, name)) and np.array_equal(value, getattr(again, name))
    assert not np.array_equal(other.skin, judged.skin)


def test_a_face_that_cannot_be_read_has_samples_and_no_regions(patient, seen):
    blank = replace(patient, bone_segment=np.full_like(patient.bone_segment, -1), segments=())
    samples = choose(blank, UNKNOWN, *seen, 500, 1)
    assert (samples.target_region == -1).all() and (samples.skin_region == -1).all()
    assert np.isnan(row(blank, patient.skin_points, seen, samples)["region_nose"])


def test_a_target_elsewhere_and_an_empty_region_are_refused():
    patient = tiny_patient()
    away = patient.skin_points + [500.0, 0, 0]
    with pytest.raises(InputError, match="case 'P1'.*covers nothing.*Remedy"):
        choose(patient, UNKNOWN, away, patient.skin_faces, 100, 0)
    none = replace(patient, face_roi=np.zeros_like(patient.face_roi))
    with pytest.raises(InputError, match="no skin face"):
        choose(none, UNKNOWN, patient.skin_points, patient.skin_faces, 100, 0)
