"""The generated page of the configuration and the overlays."""

from pathlib import Path

import jsonschema
import pytest
import yaml
from document_config import RECIPES, ROOT, columns_page, commented, config_page, rules_page

from pinnochio.study.schema import read_schema, resolved
from tests.helpers.study import Project

SCHEMA = read_schema(ROOT)


def merged(overlay: Path) -> dict:
    def merge(base, top):
        return {
            k: merge(base[k], top[k]) if isinstance(top.get(k), dict) else top.get(k, base.get(k)) for k in base | top
        }

    return merge(yaml.safe_load((ROOT / "config/config.yaml").read_text()), yaml.safe_load(overlay.read_text()))


def test_page_is_what_the_schema_says():
    assert (ROOT / "config/README.md").read_text() == config_page(), "run `make docs`"


def test_page_of_the_columns_is_what_the_tables_are_checked_by():
    assert (ROOT / "docs/reference/columns.md").read_text() == columns_page(), "run `make docs`"


def test_page_of_the_rules_is_what_snakemake_draws(tmp_path):
    said = Project(tmp_path).forked("--rulegraph", "mermaid-js").stdout
    assert (ROOT / "docs/reference/rules.md").read_text() == rules_page(said), "run `make docs`"


def test_every_key_of_the_configuration_has_its_reason():
    text = (ROOT / "config/config.yaml").read_text()
    assert text == commented(text, SCHEMA), "run `make docs`"
    for key in ("nodes: 5000", "poisson: 0.49", "folds: 5", "methods: ["):
        before = text[: text.index(key)].splitlines()
        assert before[-2 if not before[-1].strip() else -1].lstrip().startswith("## "), key


@pytest.mark.parametrize("recipe", RECIPES, ids=lambda recipe: recipe[0])
def test_a_recipe_gives_a_valid_configuration(recipe, tmp_path):
    (tmp_path / "own.yaml").write_text(recipe[1])
    jsonschema.Draft202012Validator(SCHEMA).validate(merged(tmp_path / "own.yaml"))
    assert merged(tmp_path / "own.yaml") != yaml.safe_load((ROOT / "config/config.yaml").read_text())


def test_every_key_is_explained():
    def keys(node):
        for key, entry in node.get("properties", {}).items():
            entry = resolved(entry, SCHEMA)
            assert entry.get("description"), key
            keys(entry)

    keys(SCHEMA)
    keys(SCHEMA["$defs"]["phase"])
