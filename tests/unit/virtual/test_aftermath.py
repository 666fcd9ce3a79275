"""Changes beyond mechanics: local, along the skin's normal, decided by what they say, of the asked size."""

from dataclasses import replace

import numpy as np
import pytest

from pinnochio.model.labels import AIR, SUPERFICIAL
from pinnochio.plans.plan import Plan, RigidMotion
from pinnochio.virtual import ground_truth
from pinnochio.virtual.aftermath import (
    DECIDED,
    GAINS,
    OPEN,
    RESPONSE,
    UNSOURCED,
    Circumstances,
    Site,
    expression,
    gain,
    lip_gap,
)
from pinnochio.virtual.covariates import Covariates
from pinnochio.virtual.published_thickness import PUBLISHED
from tests.helpers.heads import dome


def on(x, z):
    """Place on a sphere of 80 mm in front."""
    return np.array([x, -np.sqrt(80.0**2 - x**2 - z**2), z])


MARKS = {
    "nasion": on(0, 40),
    "pronasale": on(0, 14) * 1.15,
    "subnasale": on(0, 10),
    "labrale_superius": on(0, -2),
    "labrale_inferius": on(0, -14),
    "mentolabial": on(0, -24),
    "pogonion_soft": on(0, -36),
    "menton_soft": on(0, -46),
    "cheilion_left": on(25, -8),
    "cheilion_right": on(-25, -8),
    "tragus_left": on(70, 20),
    "tragus_right": on(-70, 20),
    "upper_incisor": np.array([0.0, -65, -5]),
    "lower_incisor": np.array([0.0, -63, -8]),
    "pogonion_bone": np.array([0.0, -65, -36]),
}
USUAL = Covariates("female", 25.0, 23.5, 6.0, "simple", False)
MEAN = dict.fromkeys(PUBLISHED, 0.0)
STILL = Circumstances(0.0, 0.0, 0.0, 0.0, MEAN, 0.0, USUAL)


@pytest.fixture(scope="module")
def site():
    skin = dome()
    return Site(skin[0], skin, MARKS)


def decided(name, site, circumstances):
    """Field (n, 3) of a change that circumstances decide."""
    return site.field(DECIDED[name](circumstances))


def at(site, place):
    return np.argmin(np.linalg.norm(site.points - place, axis=1))


def test_every_change_is_an_effect_and_has_a_field():
    for kind, fields in ((ground_truth.CHANGE, DECIDED), (ground_truth.OPEN, OPEN)):
        assert list(fields) == [name for name, effect in ground_truth.EFFECTS.items() if effect.kind == kind]
    assert set(UNSOURCED) < set(DECIDED)


def test_normals_point_out_of_the_skin(site):
    assert (np.sum(site.outward * site.points, 1) > 0.98 * 80).all()
    inside = Site(0.8 * site.points, site.skin, MARKS)
    assert (np.sum(inside.outward * site.points, 1) > 0.98 * 80).all()


@pytest.mark.parametrize(
    ("name", "place", "circumstances", "amount"),
    [
        ("lower_lip", MARKS["labrale_inferius"], replace(STILL, mandible=5.0), -0.9 / 0.72),
        ("lower_lip", MARKS["labrale_inferius"], replace(STILL, mandible=5.0, gap=4.0), -1.26 / 0.72),
        ("lower_lip", MARKS["labrale_inferius"], replace(STILL, mandible=-5.0), 0.4 / 0.72),
        ("chin_pad", MARKS["pogonion_soft"], replace(STILL, chin=10.0), -0.25 / 0.72),
        ("chin_pad", MARKS["mentolabial"], replace(STILL, chin=10.0), 1.0 / 0.72),
        ("upper_lip", MARKS["labrale_superius"], replace(STILL, maxilla=5.0), -3.5 / 0.72),
        ("upper_lip", MARKS["subnasale"], replace(STILL, maxilla=5.0), -3.1 / 0.72),
        ("paranasal", on(25, 16), replace(STILL, maxilla=10.0), 0.8 / 0.72),
    ],
)
def test_a_change_has_its_mean_where_it_belongs_and_none_on_the_forehead(site, name, place, circumstances, amount):
    field = decided(name, site, circumstances)
    outward = np.sum(field * site.points, 1) / 80
    assert outward[at(site, place)] == pytest.approx(amount, rel=0.3, abs=0.1)
    assert np.linalg.norm(field[at(site, on(0, 60))]) < 0.02


def test_who_sits_up_loses_below_the_eyes_more_so_when_heavy_or_old(site):
    heavy, old = replace(USUAL, bmi=30.5), replace(USUAL, age=45.0)
    usual, mass, age = (
        np.sum(decided("posture", site, replace(STILL, covariates=c)) * site.outward, axis=1)
        for c in (USUAL, heavy, old)
    )
    for region in ("infraorbital", "malar"):
        middle = at(site, site.regions[f"{region}_left"][0])
        assert mass[middle] < usual[middle] < -0.3
    assert np.allclose(age, 1.2 * usual) and np.abs(usual[at(site, on(0, 60))]) < 0.1


def test_sutures_and_thickness_decide(site):
    moved, thick = replace(STILL, maxilla=5.0), MEAN | {"labrale_superius": 1.0, "labrale_inferius": 1.0}
    sutured = replace(moved, covariates=replace(USUAL, closure="vy", cinch=True))
    lip, nose = at(site, MARKS["labrale_superius"]), at(site, site.regions["wing_left"][0])

    def out(name, c):
        return decided(name, site, c)[lip] @ site.points[lip] / 80

    assert out("upper_lip", sutured) - out("upper_lip", moved) == pytest.approx(1.75 / 0.72, rel=0.15)
    assert abs(out("upper_lip", replace(moved, thickness=thick)) - out("upper_lip", STILL)) < abs(
        out("upper_lip", moved) - out("upper_lip", STILL)
    )
    wide, narrow = (decided("alar_width", site, c)[nose, 0] for c in (moved, sutured))
    assert wide == pytest.approx(2 * narrow) and narrow > 0
    assert decided("alar_width", site, moved)[at(site, on(-12, 10)), 0] < 0


def test_swelling_fades_with_the_months(site):
    later = replace(STILL, covariates=replace(USUAL, months=12.0))
    one, other = (decided("swelling", site, c) for c in (STILL, later))
    cheek = at(site, site.regions["cheek_left"][0])
    share = np.linalg.norm(other[cheek]) / np.linalg.norm(one[cheek])
    assert share == pytest.approx((39.54 - 13.14 * np.log(12)) / (39.54 - 13.14 * np.log(6)))
    assert (np.sum(one * site.points, 1) >= 0).all() and one.any()


def test_the_gain_is_a_share_of_the_motion(site):
    motion = np.tile([0.0, -5, 1], (len(site.points), 1))
    fields = np.array([gain(site, motion, STILL, np.random.default_rng(seed)) for seed in range(400)])
    lip = fields[:, at(site, MARKS["labrale_inferius"])]
    assert np.allclose(np.cross(lip, motion[0]), 0)
    assert (lip @ motion[0] / (motion[0] @ motion[0])).std() == pytest.approx(GAINS["lower_lip"], rel=0.2)


def test_the_response_has_its_spread_on_both_sides_and_leaves_the_forehead(site):
    still = np.zeros_like(site.points)
    fields = np.array([OPEN["response"](site, still, STILL, np.random.default_rng(seed)) for seed in range(200)])
    outward = np.einsum("knx,nx->kn", fields, site.outward)
    right, left = (outward[:, at(site, site.regions[f"cheek_{side}"][0])] for side in ("right", "left"))
    assert abs(left.mean()) < 0.2 and left.std() == pytest.approx(np.hypot(RESPONSE["cheek"] / 0.72, 0.9), rel=0.25)
    assert 0.5 < np.corrcoef(left, right)[0, 1] < 0.8
    assert np.abs(fields[:, at(site, on(0, 60))]).max() < 0.12  # of its 1.6 mm at the lip


def test_swelling_varies_about_its_mean(site):
    still = np.zeros_like(site.points)
    fields = np.array([OPEN["swelling_level"](site, still, STILL, np.random.default_rng(seed)) for seed in range(800)])
    cheek = at(site, site.regions["cheek_left"][0])
    mean = np.linalg.norm(decided("swelling", site, STILL)[cheek])
    outward = fields[:, cheek] @ site.outward[cheek]
    assert outward.mean() == pytest.approx(0, abs=0.06 * mean) and outward.min() > -mean
    assert outward.std() == pytest.approx(mean * np.sqrt(np.exp(0.25) - 1), rel=0.15)


def test_expression_has_its_spread_and_leaves_the_forehead(site):
    fields = np.array([expression(site, np.random.default_rng(seed)) for seed in range(400)])
    lip = at(site, site.regions["lower_lip"][0])
    assert np.linalg.norm(fields[:, lip], axis=1).std() == pytest.approx(0.4 / 0.72 * np.sqrt(1 - 2 / np.pi), rel=0.2)
    assert np.abs(fields[:, at(site, on(0, 60))]).max() < 0.06


def test_motions_are_those_of_the_plan_whatever_its_pieces_are_called():
    forward, up = RigidMotion(translation=np.array([0.0, -6, 0])), RigidMotion(translation=np.array([0.0, -2, 4]))
    two = Plan("x", {"lefort1_left": forward, "lefort1_right": up, "mandible": forward})
    both = Circumstances.of(two, MARKS, MEAN, 20.0, USUAL)
    assert (both.maxilla, both.impaction, both.mandible, both.chin) == (4.0, 2.0, 6.0, 6.0) and both.gap == 8.0
    chin = Circumstances.of(Plan("x", {"mandible_distal": forward, "chin": up}), MARKS, MEAN, 0.0, USUAL)
    assert (chin.maxilla, chin.mandible, chin.chin) == (0.0, 6.0, 2.0)


def test_the_gap_is_the_air_between_the_lips():
    labels = np.full((41, 40, 60), SUPERFICIAL, np.uint8)
    labels[:, :, 28:31] = AIR
    marks = {"labrale_superius": np.array([0.0, -100, -40]), "labrale_inferius": np.array([0.0, -99, -52])}
    assert lip_gap(labels, np.ones(3), np.array([-20.0, -110, -75]), marks) == 3.0
