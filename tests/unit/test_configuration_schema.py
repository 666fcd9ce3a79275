"""A configuration is read as its schema asks, and a wrong key is named with what is allowed."""

import copy
import math

import pytest
import yaml

from pinnochio.errors import InputError
from pinnochio.overlays import overlaid
from pinnochio.study.schema import checked, read_schema, refuse_doubled
from tests.helpers.settings import CONFIG, ROOT

SCHEMA = read_schema(ROOT)


def as_text(value):
    """What Snakemake makes of the value where it stands in a mapping or list of `--config`."""
    if isinstance(value, dict):
        return {key: as_text(item) for key, item in value.items()}
    if isinstance(value, list):
        return [as_text(item) for item in value]
    return yaml.safe_dump(value).removesuffix("...\n").strip().strip("'\"")


def types(value):
    """The types of all that a configuration holds; 1 and 1.0 are one number."""
    if isinstance(value, dict):
        return {key: types(item) for key, item in value.items()}
    return [types(item) for item in value] if isinstance(value, list) else {int: float}.get(type(value), type(value))


def said(**changes):
    with pytest.raises(InputError) as refused:
        checked(overlaid(CONFIG, changes), SCHEMA)
    return str(refused.value)


@pytest.mark.parametrize("overlay", ["config", "quick", "paper"])
def test_a_whole_study_as_text_is_the_one_of_the_file(overlay):
    config = overlaid(CONFIG, yaml.safe_load((ROOT / f"config/{overlay}.yaml").read_text(encoding="utf-8")))
    read = checked(as_text(config), SCHEMA)
    assert read == config and checked(config, SCHEMA) == config
    assert types(read) == types(config)


@pytest.mark.parametrize(
    ("place", "text", "value"),
    [
        ("repair.limit", "5", 5),
        ("fem.poisson", "0.45", 0.45),
        ("fem.tolerance", "1e-6", 1e-6),
        ("fem.tolerance", "+.5E-2", 0.005),
        ("fem.increments", 4.0, 4),
        ("network.match_parameters", "TRUE", True),
        ("fem.accuracy", "exact", "exact"),
        ("fem.accuracy", "0.1", 0.1),
        ("labels.muscle", "7", 7),
        ("labels.muscle", "Muscle 7", "Muscle 7"),
        ("virtual.outcome.effects.swelling", "nominal", "nominal"),
        ("virtual.outcome.effects.swelling", "0", 0),
        ("stability.unit", "[0.1, 1e-3]", [0.1, 1e-3]),
        ("external", {"mine": "1"}, {"mine": "1"}),
        ("models", "007", "007"),
        ("models", "true", "true"),
        ("variants.pinnochio", {"network": {"heads": "2"}}, {"network": {"heads": 2}}),
    ],
)
def test_text_is_read_as_the_schema_asks_and_stays_text_where_text_is_wanted(place, text, value):
    *sections, key = place.split(".")
    config = copy.deepcopy(CONFIG)
    section = config
    for name in sections:
        section = section[name]
    section[key] = text
    read = checked(config, SCHEMA)
    for name in (*sections, key):
        read = read[name]
    assert read == value and type(read) is type(value)
    assert section[key] is text  # what was handed in is left as it was


def test_an_absent_key_with_a_default_is_filled_in():
    assert checked(CONFIG | {"pathvars": {}}, SCHEMA)["pathvars"] == {"results": "results"}


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"mesh": {"nodez": "3"}}, ["mesh.nodez ('3') is unknown", "mean mesh.nodes: integer, >= 500, <= 200000"]),
        ({"nodes": 3}, ["nodes (3) is unknown", "did you mean mesh.nodes"]),
        ({"report": {"patient": 1}}, ["report.patient (1) is unknown", "did you mean report.patients"]),
        ({"xyzzy": 1}, ["xyzzy (1) is unknown", "known are pathvars, seed"]),
        ({"variants": {"a": {"network": {"head": 1}}}}, ["variants.a.network.head (1)", "a.network.heads: integer"]),
        ({"fem": {"poisson": "0.6"}}, ["fem.poisson is 0.6; allowed: number, > 0, <= 0.4999 (Poisson's ratio)"]),
        ({"fem": {"volumetric": "p2"}}, ["fem.volumetric is 'p2'; allowed: patch, p1 (Volume term"]),
        ({"folds": "abc"}, ["folds is 'abc'; allowed: integer, >= 2, <= 100"]),
        ({"folds": True}, ["folds is True; allowed: integer"]),
        ({"fem": 3}, ["fem is 3; allowed: object"]),
        ({"segments": []}, ["segments: [] should be non-empty; allowed: array of string"]),
        ({"variants": {"Big": {}}}, ["variants: 'Big' does not match"]),
        ({"predict": {"other_segments": "maybe"}}, ["predict.other_segments is 'maybe'; allowed: refuse, predict"]),
        ({"tradeoff": {"nodes": ["900", "9"]}}, ["tradeoff.nodes[1] is 9; allowed: integer, >= 500"]),
        (
            {"virtual": {"outcome": {"effects": {"nose": 1, "swelling": "-1"}}}},
            ["effects.nose (1) is unknown", "mean virtual.outcome.effects.noise", "swelling is -1; allowed"],
        ),
        ({"fem": {"time_limit": ".inf"}}, ["fem.time_limit is inf, which is not finite"]),
        ({"stability": {"unit": [0.1, math.nan]}}, ["stability.unit[1] is nan, which is not finite"]),
        ({"predict": {"accuracy": "0"}}, ["predict.accuracy is 0; allowed: number, >= 0.001, <= 2"]),
        ({"predict": {"accuracy": -0.1}}, ["predict.accuracy is -0.1; allowed: number, >= 0.001, <= 2"]),
        ({"predict": {"seconds": "near"}}, ["predict.seconds is 'near'; allowed: number, > 0, <= 3600"]),
        ({"predict": {"seconds": 0}}, ["predict.seconds is 0; allowed: number, > 0, <= 3600"]),
        ({"predict": {"seconds": -1}}, ["predict.seconds is -1; allowed: number, > 0"]),
        ({"predict": {"seconds": ".nan"}}, ["predict.seconds is nan, which is not finite"]),
        ({"fem": {"accuracy": 0}}, ["fem.accuracy is 0; allowed: `exact` or number, >= 0.001, <= 2"]),
    ],
)
def test_a_wrong_key_is_named_with_its_value_and_what_is_allowed(changes, words):
    text = said(**changes)
    assert len(text.splitlines()) <= 2 and len(text) < 1000
    for word in words:
        assert word in text, text


def test_a_missing_key_is_named():
    config = copy.deepcopy(CONFIG)
    del config["mesh"]["nodes"], config["virtual"]["outcome"]["effects"]["frame"]
    with pytest.raises(InputError) as refused:
        checked(config, SCHEMA)
    assert "mesh.nodes is missing: integer, >= 500" in str(refused.value)
    assert "virtual.outcome.effects.frame is missing: number" in str(refused.value)


def test_many_wrong_keys_are_counted():
    text = said(fem={f"key{number}": number for number in range(9)})
    assert text.count("is unknown") == 5 and "and 4 more" in text and len(text.splitlines()) == 6


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("seed: 1\nfolds: 5\nseed: 2\n", "'seed' stands in lines 1 and 3"),
        ("fem:\n  poisson: 0.45\n  poisson: 0.49\n", "'poisson' stands in lines 2 and 3"),
        ("fem: {poisson: 0.45, poisson: 0.49}\n", "'poisson' stands in lines 1 and 1"),
        ('{"methods": [{"a": 1,\n"a": 2}]}', "'a' stands in lines 1 and 2"),
    ],
)
def test_a_key_that_stands_twice_is_refused(tmp_path, text, words):
    file = tmp_path / "mine.yaml"
    file.write_text(text, encoding="utf-8")
    with pytest.raises(InputError, match=words) as caught:
        refuse_doubled(file)
    assert "mine.yaml" in str(caught.value)


def test_the_configurations_of_the_project_hold_no_key_twice():
    for file in (ROOT / "config").glob("*.yaml"):
        refuse_doubled(file)
