"""Seconds in, millimetres out: what the front allows, on a machine of any speed."""

from itertools import pairwise

import pytest

from pinnochio.errors import InputError
from pinnochio.json_text import read_stored_json, write_json
from pinnochio.patients.front import FRONT, within
from tests.helpers.patients import tiny_patient, tiny_plan
from tests.helpers.settings import fem_settings

LINEAR = 0.01  # s of a linear field
# method, accuracy, mm, times, on the front
SETTINGS = (
    ("elastic", "", 1.2, 1, True),
    ("pinnochio_plus", "", 1.0, 4, False),
    ("fem_sliding", 0.5, 0.1, 20, True),
    ("fem_sliding", 0.2, 0.09, 30, False),
    ("fem_sliding", "exact", 0.0, 60, True),
)


@pytest.fixture
def expected(tmp_path, monkeypatch):
    """What is expected within so many seconds of the smallest patient, whose linear field takes LINEAR."""
    patient = tiny_patient()
    names = "method", "accuracy", "mm", "times", "front"
    rows = [dict(zip(names, row, strict=True)) for row in SETTINGS]
    rows = [row | {"mm_95": 2 * row["mm"], "times_95": 2 * row["times"]} for row in rows]
    monkeypatch.setattr("pinnochio.patients.front.repeated", lambda solve: (solve(), LINEAR))

    def of(seconds, nodes=0):
        write_json(tmp_path / "front.json", {"nodes": nodes or len(patient.points), "settings": rows})
        return within(seconds, patient, tiny_plan(), fem_settings(), tmp_path / "front.json")

    return of


@pytest.mark.parametrize(
    ("seconds", "method", "accuracy"),
    [(0.021, "elastic", ""), (0.39, "elastic", ""), (0.41, "fem_sliding", 0.5), (9, "fem_sliding", "exact")],
)
def test_the_nearest_that_95_of_100_plans_keep_and_nothing_off_the_front(expected, seconds, method, accuracy):
    best = expected(seconds)
    assert (best.method, best.accuracy) == (method, accuracy) and f"({seconds:g} wished)" in best.words
    if accuracy == 0.5:
        assert "in 0.2 s" in best.words and "0.1 mm from the converged field in the mean, 0.2 on 5" in best.words


def test_fewer_seconds_than_the_fastest_takes_are_refused(expected):
    with pytest.raises(InputError, match=r"predict.seconds is 0.019, and elastic, the fastest, takes 0.02 here"):
        expected(0.019)


def test_a_mesh_of_another_size_than_the_fronts_is_refused(expected):
    with pytest.raises(InputError, match=r"meshes of about 5000 nodes, and this one has 140.*predict.accuracy"):
        expected(9, nodes=5000)


def test_the_front_that_comes_with_the_models_gets_nearer_as_it_gets_slower():
    settings = [one for one in read_stored_json(FRONT)["settings"] if one["front"]]
    assert settings[0]["method"] == "elastic" and len(settings) > 2
    for one, other in pairwise(settings):
        assert one["mm"] > other["mm"] and one["times"] < other["times"]
