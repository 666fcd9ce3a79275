"""The deal of operations: the shares asked for, what suits a deformity, variety from the first patients on."""

from collections import Counter

import pytest

from pinnochio.virtual.procedures import (
    DEFORMITIES,
    GENIOPLASTY,
    JAWS,
    MANDIBLE,
    MAXILLA,
    SEGMENTAL,
    SUITED,
    Procedure,
    dealt,
)
from tests.helpers.settings import CONFIG

SHARES = CONFIG["virtual"]["procedures"]


def test_a_cohort_has_the_shares_and_each_deformity_what_suits_it():
    many = dealt(SHARES, 40)
    total = sum(SHARES[jaws] for jaws in JAWS)
    count = Counter(one.jaws for one in many)
    for jaws in JAWS:
        assert count[jaws] == pytest.approx(40 * SHARES[jaws] / total, abs=2.5), jaws
    assert sum(one.chin for one in many) == pytest.approx(40 * SHARES[GENIOPLASTY], abs=0.5)
    upper = [one for one in many if one.jaws != MANDIBLE]
    pieces = Counter(one.pieces for one in upper)
    assert pieces[2] + pieces[3] == pytest.approx(len(upper) * SHARES[SEGMENTAL], abs=0.5)
    assert abs(pieces[2] - pieces[3]) <= 1
    for number, one in enumerate(many):
        assert one.jaws in SUITED[DEFORMITIES[number % 4]]
    for deformity in range(4):
        assert len({one.jaws for one in many[deformity::4]}) > 1


def test_six_patients_differ_already():
    few = dealt(SHARES, 6)
    assert few == dealt(SHARES, 40)[:6]
    assert {made.jaws for made in few} == {*JAWS}
    assert {made.chin for made in few} == {True, False} and any(made.pieces > 1 for made in few)


def test_a_share_of_nothing_is_not_dealt():
    assert {*dealt(SHARES | dict.fromkeys((MANDIBLE, MAXILLA, GENIOPLASTY, SEGMENTAL), 0), 12)} == {Procedure()}
    assert not any(made.jaws == MAXILLA for made in dealt(SHARES | {MAXILLA: 0}, 40))


def test_a_procedure_names_its_segments():
    assert Procedure().segments == ("lefort1", "mandible_distal", "proximal_left", "proximal_right")
    assert Procedure(MANDIBLE, chin=True).segments == ("mandible_distal", "proximal_left", "proximal_right", "chin")
    made = Procedure(MAXILLA, 3)
    assert made.segments == ("lefort1_left", "lefort1_right", "lefort1_front", "mandible")
    assert made.name == "maxilla only, 3-piece maxilla" and Procedure(chin=True).name == "bimaxillary, genioplasty"
    assert {name for made in dealt(SHARES, 40) for name in made.segments} == set(CONFIG["segments"])
