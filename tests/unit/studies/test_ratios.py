"""Soft-to-hard tissue ratios of the virtual cohort."""

import numpy as np
import pytest

from pinnochio.plans.plan import Plan, RigidMotion
from studies.cohort_checks.ratios import RATIOS, STILL, motions, summarise


def field(shares):
    """Tetrahedra round each landmark that carry a share of 10 mm forward."""
    corners = np.array([[1.0, 1, 1], [-1, -1, 1], [-1, 1, -1], [1, -1, -1]])
    names = [ratio.soft for ratio in RATIOS.values()] + [STILL]
    marks = {name: np.array([0.0, 0, 20 * i]) for i, name in enumerate(names)}
    points = np.concatenate([marks[name] + corners for name in names])
    cells = np.arange(len(points)).reshape(-1, 4)
    moved = np.repeat([[0.0, -10 * share, 0] for share in shares], 4, axis=0)
    return marks | {ratio.hard: np.zeros(3) for ratio in RATIOS.values()}, points, cells, moved


def test_ratio_is_the_slope_of_forward_motion():
    shares = [0.92, 0.95, 0.65, 0.3, 0.5, 0.25, 0.0]
    marks, *mesh = field(shares)
    forward = RigidMotion(translation=np.array([3.0, -10, 2]))
    plan = Plan("x", {"mandible_distal": forward, "lefort1": forward})
    patient = motions(marks, plan, *mesh)
    twice = {name: (2 * soft, 2 * hard) for name, (soft, hard) in patient.items()}
    more = {name: (1.5 * soft, hard) for name, (soft, hard) in patient.items()}
    table = summarise([patient, twice], [more, twice])
    assert table["whole"].to_numpy()[:-1] == pytest.approx([1.1 * share for share in shares[:-1]])
    assert table["ours"].to_numpy() == pytest.approx(shares) and table["inside"].all() and (table["n"] == 2).all()
    far = [{name: (1.2 * hard, hard) for name, (_, hard) in patient.items()} | {STILL: (0.3, 0.0)}]
    high = summarise(far, far)
    assert not high["inside"].any()


def test_a_bone_that_stays_says_nothing():
    marks, *mesh = field([0.5] * 7)
    patients = [motions(marks, Plan("x", {}), *mesh)]
    still = summarise(patients, patients)
    assert (still["n"].to_numpy()[:-1] == 0).all()
