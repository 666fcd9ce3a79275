"""What every method is, the settings that the configuration gives it, and how people write its name."""

import pandas as pd
import pytest

from pinnochio.code import source_file
from pinnochio.columns import Column
from pinnochio.methods.names import spoken
from pinnochio.methods.registry import (
    BUILT_IN,
    GRAPH_NETWORK,
    SURFACE_NETWORK,
    graph_networks,
    registry,
    surface_networks,
)
from pinnochio.tables.document import Block, Table
from pinnochio.tables.formats import write_table
from studies.design.switches import switched
from tests.helpers.settings import CONFIG


def test_every_method_of_the_configuration_is_registered_once_with_a_module():
    methods = registry(CONFIG)
    assert set(CONFIG["methods"]) <= set(methods) and all(name == method.name for name, method in methods.items())
    assert len({method.name for method in BUILT_IN}) == len(BUILT_IN)
    for method in (*BUILT_IN, GRAPH_NETWORK, SURFACE_NETWORK):
        assert source_file(method.predictor).is_file()


def test_finite_elements_with_lips_have_a_mesh_contact_and_solver_for_them():
    methods = registry(CONFIG)
    lips = {"fem_rlse", "fem_rlse_bonded", "fem_rlse_mucosa"}
    assert {name for name, method in methods.items() if method.mesh == "lips"} == lips
    plain, lipped = methods["fem_sliding"].settings, methods["fem_rlse"].settings
    assert plain == {"fem": CONFIG["fem"], "contact": "mucosa"}
    assert lipped["contact"] == "mucosa+lip"
    solver = {name: CONFIG["fem_rlse"][name] for name in ("increments", "tolerance")}
    assert lipped["fem"] == CONFIG["fem"] | solver


def test_methods_that_predict_new_patients_are_those_that_need_no_fold_of_theirs():
    methods = registry(CONFIG)
    without = {name for name, method in methods.items() if method.new_patients and method.trains == "no"}
    assert without == {"elastic", "fem_bonded", "fem_sliding"}
    assert methods["pinnochio_plus"].new_patients and not methods["acmt"].new_patients


def test_variants_are_overlays_and_leave_the_rest_alone():
    networks = graph_networks(CONFIG)
    assert networks["pinnochio"] == {
        key: CONFIG[key] for key in ("network", "pretraining", "finetuning", "newton_corrections")
    }
    silent = networks["pinnochio_no_physics"]
    assert silent["pretraining"]["weights"] == CONFIG["pretraining"]["weights"] | {"physics": 0}
    assert silent["network"] == CONFIG["network"]
    plus, wide = networks["pinnochio_plus"], switched(CONFIG["design"], networks)["design_wide"]
    assert wide == plus | {"network": plus["network"] | {"channels": 128}}
    assert CONFIG["network"]["lift"] == "none" and plus["network"]["lift"] == "elastic"


def test_a_surface_network_is_two_methods_that_differ_in_their_pretraining():
    networks = surface_networks(CONFIG)
    assert sorted(networks) == ["acmt", "acmt_pretrained", "dgcfp", "dgcfp_pretrained", "fscnet", "fscnet_pretrained"]
    alone, pretrained = networks["dgcfp"], networks["dgcfp_pretrained"]
    assert pretrained == alone | {"pretraining": CONFIG["surface"]["networks"]["dgcfp"]["pretraining"]}
    sizes = {key: CONFIG["surface"][key] for key in ("points", "neighbours", "repeats")}
    assert alone["network"] == sizes | {"architecture": "dgcfp", "mixed_precision": True}


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("fem_sliding", "Sliding FEM"),
        ("ratio", "Soft-to-hard ratios"),
        ("smallest volume ratio, linear elastic", "smallest volume ratio, linear elastic"),
        ("pinnochio before fem_rlse", "PINNOCHIO before FEM-RLSE, lips in contact"),
        ("Below no_change. no_change: 1 mm", "Below no change. No change: 1 mm"),
        ("random pinnochio_plus, repair", "random PINNOCHIO plus, repair"),
        ("beaten by design_narrow, corrections 1", "beaten by design narrow, corrections 1"),
        ("my_pinnochio_plus_2", "my_pinnochio_plus_2"),
    ],
)
def test_a_text_says_the_names_that_people_write(text, said):
    assert spoken(text) == said


def test_the_twins_say_them_too_and_html_keeps_the_short_one(tmp_path):
    block = Block(["Method"], [[("fem_sliding", True)], [("own", False)]], "Of fem_sliding.")
    table = Table(pd.DataFrame({"n": [1]}), [Column("n", int, "", "number")], [block], ["Also fem_sliding."])
    path = tmp_path / "a.csv"
    write_table(table, path)
    for suffix in (".md", ".tex"):
        text = path.with_suffix(suffix).read_text()
        assert text.count("liding FEM") == 3 and "fem_sliding" not in text
    assert '<td title="fem_sliding"><b>Sliding FEM</b></td>' in (page := path.with_suffix(".html").read_text())
    assert "<td>own</td>" in page
