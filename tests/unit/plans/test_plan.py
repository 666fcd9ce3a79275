"""Plans: rigid motions, their inverse and fraction, and what is refused."""

import json

import numpy as np
import pytest

from pinnochio.errors import InputError
from pinnochio.plans.plan import Plan, RigidMotion

MOTION = RigidMotion.from_degrees((10, -4, 25), (1.0, -5.0, 2.0), (3.0, 40.0, -7.0))
POINTS = np.random.default_rng(0).normal(0, 50, (20, 3))


def test_motion_turns_about_the_pivot():
    quarter = RigidMotion.from_degrees((0, 0, 90), (0, 0, 1), (10, 0, 0))
    np.testing.assert_allclose(quarter.apply(np.array([[12.0, 0, 0]])), [[10, 2, 1]], atol=1e-12)


def test_inverse_undoes_the_motion():
    np.testing.assert_allclose(MOTION.inverse(MOTION.apply(POINTS)), POINTS, atol=1e-10)
    np.testing.assert_allclose(MOTION.back.apply(MOTION.apply(POINTS)), POINTS, atol=1e-9)


def test_fraction_is_rigid_and_ends_at_the_motion():
    np.testing.assert_allclose(MOTION.fraction(1).apply(POINTS), MOTION.apply(POINTS), atol=1e-10)
    half = MOTION.fraction(0.5)
    np.testing.assert_allclose(half.rotation @ half.rotation, MOTION.rotation, atol=1e-12)
    np.testing.assert_allclose(half.translation, MOTION.translation / 2)


def test_plan_survives_writing_and_reading(tmp_path):
    plan = Plan("P1", {"lefort1": MOTION})
    plan.write(tmp_path / "plan.json")
    back = Plan.read(tmp_path / "plan.json", "P1")
    np.testing.assert_array_equal(back.motion("lefort1").apply(POINTS), MOTION.apply(POINTS))
    np.testing.assert_array_equal(back.motion("mandible_distal").apply(POINTS), POINTS)


def test_a_rotation_of_five_decimals_is_made_one_and_that_is_said(caplog):
    said = json.loads(Plan("P1", {"lefort1": MOTION}, ("odd",)).to_json())
    said["segments"]["lefort1"]["rotation"] = np.round(MOTION.rotation, 5).tolist()
    made = Plan.from_json(json.dumps(said), "plan.json", "P1")
    rotation = made.motion("lefort1").rotation
    np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-12)
    np.testing.assert_allclose(rotation, MOTION.rotation, atol=2e-5)
    assert made.warnings == ("odd",) and "is rounded" in caplog.text
    said["segments"]["lefort1"]["rotation"] = (1.002 * MOTION.rotation).tolist()
    with pytest.raises(InputError, match="is not a rotation"):
        Plan.from_json(json.dumps(said), "plan.json", "P1")
