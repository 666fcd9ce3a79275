"""The linear floors: ratios follow the jaws, and the regression finds what is linear."""

from dataclasses import replace

import numpy as np
import pytest

from pinnochio.methods.pca_linear import LinearModel, LinearPredictor, fit, ridge
from pinnochio.methods.ratio import RATIOS, RatioRule
from pinnochio.model.regions import NAMES, regions
from pinnochio.plans.plan import Plan, RigidMotion
from tests.helpers.virtual_heads import face_alone

FORWARD = np.array([0.0, -4.0, 0.0])


def shift(segment, way=FORWARD):
    return Plan("P", {segment: RigidMotion(translation=np.asarray(way, float))})


@pytest.fixture(scope="module")
def models():
    """Three heads whose skin is the mesh."""
    return [face_alone(deformity) for deformity in ("class_iii", "class_ii", "open_bite")]


def test_regions_follow_their_jaw_by_their_share(models):
    model = models[0]
    rule, codes = RatioRule(model), regions(model)
    assert np.abs(rule(Plan("P", {}))).max() == 0
    for region, segment in (("nose", "lefort1"), ("lower_lip", "mandible_distal"), ("chin", "mandible_distal")):
        share = (rule(shift(segment)) @ FORWARD / (FORWARD @ FORWARD))[codes == NAMES.index(region)]
        assert np.median(share) == pytest.approx(RATIOS[region][1], abs=0.1), region
    both = rule(shift("lefort1")) + rule(shift("mandible_distal"))
    together = Plan("P", shift("lefort1").motions | shift("mandible_distal").motions)
    assert np.allclose(rule(together), both)
    brow = model.skin_points[:, 2] > model.skin_points[codes == NAMES.index("nose"), 2].max() + 15
    assert np.abs(both[brow]).max() < 0.5 and np.abs(rule(shift("proximal_left"))).max() == 0


def test_ridge_finds_a_linear_law_and_shrinks_before_noise():
    rng = np.random.default_rng(0)
    rows, law = rng.normal(size=(60, 4)), rng.normal(size=(5, 7))
    values, owner = np.column_stack([rows, np.ones(60)]) @ law, np.repeat(np.arange(20), 3)
    assert np.allclose(ridge(rows, values, owner), law, atol=1e-3)
    noise = rng.normal(size=(60, 7))
    shrunk, least = ridge(rows, noise, owner), np.linalg.lstsq(np.column_stack([rows, np.ones(60)]), noise)[0]
    assert np.abs(shrunk[:-1]).max() < 0.6 * np.abs(least[:-1]).max()  # there is nothing to learn


def test_regression_learns_a_share_of_the_plan_and_what_the_skins_add(models, tmp_path):
    """Skin that goes 0.6 of the mandible's way in the fields, and another 1 mm forward in the scans."""
    plans = [shift("mandible_distal", way) for way in ([0, -5, 0], [0, 4, 1], [2, -1, -2], [-2, 3, 2])]

    def field(model, plan):
        return np.tile(0.6 * plan.motion("mandible_distal").translation, (len(model.points), 1))

    samples = [[(plan, field(model, plan)) for plan in plans] for model in models]
    skins = [(model.skin_points + field(model, plans[0]) + [0, -1.0, 0], model.skin_faces) for model in models]
    linear = fit(models, samples, [plans[0]] * 3, skins)
    linear.write(tmp_path / "linear.h5")
    predict = LinearPredictor(LinearModel.read(tmp_path / "linear.h5"), models[1])
    alone = LinearPredictor(replace(linear, adapted=0 * linear.adapted), models[1])
    plan = shift("mandible_distal", [1.0, -3.0, 1.0])
    assert np.allclose(alone(plan), [0.6, -1.8, 0.6], atol=0.05)
    face = np.unique(models[1].skin_faces[models[1].face_roi])
    added = (predict(plan) - alone(plan))[face]
    assert -1.1 < np.median(added[:, 1]) < -0.2  # the way to the nearest point is shorter where the skin is oblique
