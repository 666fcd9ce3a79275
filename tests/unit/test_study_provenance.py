"""A changed configuration is noticed where Snakemake has lost its metadata."""

import json
from base64 import urlsafe_b64encode

import pytest

from pinnochio.study.provenance import changed_since, forgotten

CONFIG = {
    "seed": 1,
    "mesh": {"nodes": 5000, "bone_edge": 5},
    "patient": "",
    "methods": ["elastic"],
    "variants": {"a": {}},
}


@pytest.fixture
def provenance(tmp_path):
    (tmp_path / "provenance.json").write_text(json.dumps({"config": CONFIG}))
    return tmp_path / "provenance.json"


@pytest.mark.parametrize(
    ("changes", "keys"),
    [
        ({}, []),
        ({"mesh": {"nodes": 5000.0, "bone_edge": 5}, "methods": ("elastic",)}, []),
        ({"patient": "P01", "report": {"patients": 2}}, []),
        ({"mesh": {"nodes": 900, "bone_edge": 4}, "seed": 2}, ["mesh.bone_edge", "mesh.nodes", "seed"]),
        ({"methods": ["elastic", "ratio"], "variants": {"a": {"network": 1}}}, ["methods", "variants.a.network"]),
        ({"fem": {"poisson": 0.4}}, ["fem"]),
    ],
)
def test_the_keys_that_differ_are_named(provenance, changes, keys):
    assert changed_since(provenance, CONFIG | changes) == keys


def test_a_key_that_is_gone_is_named(provenance):
    assert changed_since(provenance, {key: CONFIG[key] for key in CONFIG if key != "seed"}) == ["seed"]


def test_results_are_forgotten_once_the_metadata_is_gone(provenance, tmp_path):
    assert forgotten("provenance.json", tmp_path)
    record = tmp_path / ".snakemake/metadata" / urlsafe_b64encode(b"provenance.json").decode()
    record.parent.mkdir(parents=True)
    record.touch()
    assert not forgotten("provenance.json", tmp_path)
    assert not forgotten("elsewhere.json", tmp_path)
