"""Makes what is said of configuration and tables from what they are declared by: `make docs`.

config/README.md from the schema and the default configuration, docs/columns.md from the columns of the tables, and the
reasons beside the keys of config/config.yaml.
"""

import re
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path

import yaml

from pinnochio.code import ROOT
from pinnochio.study.schema import allowed, resolved

LINE = 110  # characters of a reason in the configuration

# What is often changed: what for, the overlay, what is made again, and how long that takes on two cores.
RECIPES = (
    ("Stiffer tissue", "fem: {youngs_modulus: {muscle: 10.7}}", "all but cohort, meshes and scans", "1.5 h"),
    ("Poisson's ratio", "fem: {poisson: 0.47}", "the same", "1.5 h"),
    ("A finer mesh", "mesh: {nodes: 10000}", "everything from the mesh on", "about 3 times the study: 5 h"),
    ("A coarser mesh", "mesh: {nodes: 2500}", "everything from the mesh on", "1 h"),
    ("Fewer folds", "folds: 3", "training, predictions and tables", "40 min"),
    (
        "Other methods",
        "methods: [no_change, elastic, fem_sliding]",
        "what is new, and the tables",
        "2 min; from nothing 30 min",
    ),
    ("Fewer virtual patients", "virtual: {patients: 12}", "all that folds train and predict", "30 min"),
    ("Longer training", "pretraining: {steps: 3000}", "training, predictions, tables", "2 h; use a GPU"),
    ("Predict from the plan alone", "motion: planned", "training, predictions and tables", "1 h"),
    ("Another interval", "uncertainty: {level: 0.8}", "the calibration and what shows it", "1 min"),
)
# Tables of a study and where their columns are declared.
TABLES = {
    "cases": ("pinnochio.metrics.columns", "CASES", "one row per patient and method"),
    "accuracy, better": ("pinnochio.tables.comparison", "COMPARISON", "one row per method"),
    "planned": ("pinnochio.tables.planned", "PLANNED", "one row per method, with both motions"),
    "regions, landmarks": ("pinnochio.tables.places", "PLACES", "one row per method and place"),
    "segments": ("pinnochio.tables.segments", "SEGMENTS", "registered motion of each bone segment"),
    "ablation": ("pinnochio.tables.ablation", "ABLATION", "one row per variant"),
    "training": ("pinnochio.tables.training", "TRAINING", "one row per learned method"),
    "stages": ("pinnochio.tables.stages", "STAGES", "one row per stage"),
    "tradeoff": ("pinnochio.tables.tradeoff", "TRADEOFF", "one row per setting"),
    "learning": ("pinnochio.tables.learning", "LEARNING", "one row per method and number of training patients"),
    "corrections": ("pinnochio.tables.corrections", "CORRECTIONS", "one row per method and number of corrections"),
    "coverage": ("pinnochio.tables.coverage", "COVERAGE", "one row per method and region"),
}


def document(schema: dict, defaults: dict) -> str:
    """Markdown page: recipes, then one section per block with one row per key: default, bounds, meaning."""
    lines = [
        "# Configuration",
        "",
        "Generated from `workflow/schemas/config.schema.yaml` and `config/config.yaml` by `make docs`; do not edit.",
        "",
        schema["description"],
        'An overlay (`--configfile config/quick.yaml`), `--config seed=2` or `--config fem="{poisson: 0.45}"` replaces '
        "single values.",
        "",
        "## Recipes",
        "",
        "Write the lines to a file, say `own.yaml`, and name it with `--configfile own.yaml`. Add "
        "`pathvars: {results: results/own}` to keep the study that is there. With `-n` Snakemake lists the jobs first. "
        "Times are reckoned from the default study at commit `0eb5985` (98 min on two cores), not measured.",
        "",
        "| to change | lines | made again | time |",
        "|---|---|---|---|",
        *(f"| {what} | `{overlay}` | {again} | {time} |" for what, overlay, again, time in RECIPES),
    ]
    single, blocks = [], []
    for key, entry in schema["properties"].items():
        entry = resolved(entry, schema)
        own = list(rows({"properties": {key: entry}}, defaults, schema, ""))
        (single if len(own) == 1 else blocks).append((key, own))
    lines += _section("Single keys", [row for _, own in single for row in own])
    for key, own in blocks:
        lines += _section(f"`{key}`", own)
    return "\n".join(lines) + "\n"


def _section(title: str, own: list[str]) -> list[str]:
    return ["", f"## {title}", "", "| key | default | allowed | meaning |", "|---|---|---|---|", *own]


def rows(node: dict, defaults: dict, schema: dict, prefix: str) -> Iterator[str]:
    """Table rows of an object's properties, depth first."""
    for key, entry in node["properties"].items():
        meaning, entry = _meaning(entry, schema)
        value = (defaults or {}).get(key)
        if "properties" in entry:
            yield f"| **`{prefix}{key}`** | | | {meaning} |"
            yield from rows(entry, value, schema, f"{prefix}{key}.")
        else:
            yield f"| `{prefix}{key}` | `{value}` | {allowed(entry)} | {meaning} |"


def _meaning(entry: dict, schema: dict) -> tuple[str, dict]:
    """What is said of an entry, and the entry with what it refers to."""
    entry = resolved(entry, schema)
    meaning = entry.get("description", "")
    for part in entry.get("oneOf", []):
        if "$ref" in part:
            entry = resolved(part, schema)
    return meaning, entry


def config_page(root: Path = ROOT) -> str:
    """The page for the files of a checkout."""
    schema = yaml.safe_load((root / "workflow/schemas/config.schema.yaml").read_text(encoding="utf-8"))
    return document(schema, yaml.safe_load((root / "config/config.yaml").read_text(encoding="utf-8")))


def columns_page() -> str:
    """Markdown page of the columns of every table that a study makes."""
    lines = [
        "# Columns of the tables",
        "",
        "Generated from the declarations that the tables are checked by, by `make docs`; do not edit. The twins of a "
        "table (`.md`, `.tex`, `.html`) show some of them. An empty cell: not measured, or it has no meaning there. "
        "How distances are measured: [metrics.md](metrics.md).",
    ]
    for name, (module, declared, about) in TABLES.items():
        lines += ["", f"## {name}", "", f"{about[0].upper()}{about[1:]}."]
        lines += ["", "| column | unit | meaning |", "|---|---|---|"]
        for column in getattr(import_module(module), declared):
            lines.append(f"| `{column.name}` | {column.unit} | {column.description.replace('|', '/')} |")
    return "\n".join(lines) + "\n"


def reason(meaning: str) -> str:
    """The first sentence of what is said of a key, within a line."""
    first = re.split(r"(?<=[^.]\.) |; |: ", meaning, maxsplit=1)[0].rstrip(".")
    return first if len(first) <= LINE else first[: first.rindex(" ", 0, LINE)] + " ..."


def commented(text: str, schema: dict) -> str:
    """The configuration with its reason above every key; comments that begin otherwise stay as they are."""
    lines, path = [], []
    for line in text.splitlines():
        if line.lstrip().startswith("## "):
            continue
        key = re.match(r"( *)(\w+):", line)
        if key:
            depth = len(key[1]) // 2
            path = [*path[:depth], key[2]]
            if said := _said(path, schema):
                lines.append(f"{key[1]}## {reason(said)}")
        lines.append(line)
    return "\n".join(lines) + "\n"


def _said(path: list[str], schema: dict) -> str:
    """What the schema says of a key; empty where a user names it."""
    node, meaning = schema, ""
    for key in path:
        if key not in node.get("properties", {}):
            return ""
        meaning, node = _meaning(node["properties"][key], schema)
    return meaning


if __name__ == "__main__":
    (ROOT / "config/README.md").write_text(config_page(), encoding="utf-8")
    (ROOT / "docs/columns.md").write_text(columns_page(), encoding="utf-8")
    config, schema = ROOT / "config/config.yaml", ROOT / "workflow/schemas/config.schema.yaml"
    text = commented(config.read_text(encoding="utf-8"), yaml.safe_load(schema.read_text(encoding="utf-8")))
    config.write_text(text, encoding="utf-8")
