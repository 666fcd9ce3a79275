"""Makes what is said of configuration and tables from what they are declared by: `make docs`.

config/README.md from the schema and the default configuration, docs/reference/rules.md from the graph of rules,
docs/reference/columns.md from the columns of the tables, and the reasons beside the keys of config/config.yaml.
"""

import re
import subprocess
import sys
from collections import Counter
from collections.abc import Iterator, Sequence
from importlib import import_module
from itertools import combinations
from pathlib import Path
from typing import Any

import yaml

from pinnochio.code import ROOT
from pinnochio.columns import Column
from pinnochio.study.schema import allowed, checked, read_schema, resolved

LINE = 110  # characters of a reason in the configuration
LONG = 40  # characters of a default that the page shows
SHORT = 3  # rows of a section that has no heading of its own

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
    "cases": ("pinnochio.metrics.case_columns", "CASES", "one row per patient and method"),
    "accuracy, better": ("pinnochio.tables.comparison", "COMPARISON", "one row per method"),
    "planned": ("pinnochio.tables.planned", "PLANNED", "one row per method, with both motions"),
    "regions, landmarks": ("pinnochio.tables.places", "PLACES", "one row per method and place"),
    "segments": ("pinnochio.tables.segments", "SEGMENTS", "registered motion of each bone segment"),
    "ablation": ("pinnochio.tables.ablation", "ABLATION", "one row per variant"),
    "training": ("pinnochio.tables.training", "TRAINING", "one row per learned method"),
    "stages": ("pinnochio.tables.stages", "STAGES", "one row per stage"),
    "tradeoff": ("studies.tradeoff.setting_columns", "TRADEOFF", "one row per setting"),
    "learning": ("studies.learning.table", "LEARNING", "one row per method and number of training patients"),
    "coverage": ("pinnochio.tables.coverage", "COVERAGE", "one row per method and region"),
}


def document(schema: dict, defaults: dict) -> str:
    """Markdown page: recipes, then one table per section with one row per key: default and allowed values, meaning."""
    lines = [
        "# Configuration",
        "",
        "Generated from the schemas (`workflow/schemas`, `workflow/studies`) and `config/config.yaml` by `make docs`; "
        "do not edit.",
        "",
        schema["description"],
        "`[0, 1]` allows both ends, `(0, 1)` neither. Long defaults stand in `config.yaml`, those of a study in its "
        "`schema.yaml`. "
        'An overlay (`--configfile config/quick.yaml`), `--config seed=2` or `--config fem="{poisson: 0.45}"` replaces '
        "single values.",
        "",
        "## Recipes",
        "",
        "Write the lines to a file, say `mine.yaml`, and name it with `--configfile mine.yaml`. "
        "`pathvars: {results: results/mine}` keeps the study that is there. With `-n` Snakemake only lists the jobs. "
        "Times are estimates for two cores.",
        "",
        "| to change | lines | made again | time |",
        "|---|---|---|---|",
        *(f"| {what} | `{overlay}` | {again} | {time} |" for what, overlay, again, time in RECIPES),
    ]
    short, sections = [], []
    for key, entry in schema["properties"].items():
        table = list(rows({"properties": {key: entry}}, defaults, schema, defaults))
        if len(table) <= SHORT:
            short += table
        else:
            sections += _section(f"`{key}`", table)
    return "\n".join([*lines, *_section("Short sections", short), *sections]) + "\n"


def _section(title: str, table: list[str]) -> list[str]:
    return ["", f"## {title}", "", "| key | default and what is allowed | meaning |", "|---|---|---|", *table]


def rows(
    node: dict, values: dict, schema: dict, defaults: dict, prefix: str = "", known: dict | None = None
) -> Iterator[str]:
    """Table rows of an object's properties, depth first; with `known`, the values of the section that explains the
    same keys, those alone that differ."""
    for key, entry in node["properties"].items():
        place, value = f"{prefix}{key}", (values or {}).get(key)
        home = _home(entry, schema, place)
        meaning, entry = _meaning(entry, schema)
        same = (known or {}).get(key)
        if "properties" in entry:
            if known is None:
                twin = f" Keys and defaults as in `{home}` but for the rows below." if home else ""
                yield f"| **`{place}`** | | {meaning.rstrip('.')}.{twin} |"
            other = defaults[home] if home else same if known is not None else None
            yield from rows(entry, value, schema, defaults, f"{place}.", other)
        elif known is None or (same is None and value is not None):
            cell = ": ".join(filter(None, (_shown(value), within(entry))))
            yield f"| `{place}` | {cell} | {meaning.rstrip('.')} |"
        elif value not in (None, same):
            yield f"| `{place}` | {_shown(value)} | |"


def _home(entry: dict, schema: dict, place: str) -> str:
    """The section where the keys of an entry are explained, empty for that section itself."""
    reference = entry.get("$ref", "")
    homes = [key for key, section in schema["properties"].items() if reference and section.get("$ref") == reference]
    return homes[0] if homes and homes[0] != place and "properties" in resolved(entry, schema) else ""


def _shown(value: Any) -> str:
    """A default as the page shows it, empty where it is long."""
    if value is None or value in ("", [], {}):
        return "none"
    text = ", ".join(map(str, value)) if isinstance(value, list) else str(value)
    return f"`{text}`" if len(text) <= LONG else ""


def within(entry: dict) -> str:
    """The values that an entry allows, bounds as an interval."""
    if "oneOf" in entry:
        return " or ".join(
            within(part) or part["type"] for part in entry["oneOf"] if not {"$ref", "const"} & part.keys()
        )
    kind = entry.get("type")
    if kind == "boolean":
        return "true, false"
    if kind == "array" and "enum" not in entry["items"]:
        return f"list of {within(entry['items'])}".removesuffix(" of ")
    if kind in ("string", "object"):
        return allowed(entry) if "enum" in entry else ""
    if "enum" in entry or kind not in ("integer", "number"):
        return allowed(entry)
    low = f"[{entry['minimum']}" if "minimum" in entry else f"({entry['exclusiveMinimum']}"
    name = "integer " if kind == "integer" else ""
    if "maximum" in entry:
        return f"{name}{low}, {entry['maximum']}]"
    if "exclusiveMaximum" in entry:
        return f"{name}{low}, {entry['exclusiveMaximum']})"
    return f"{name}{'>=' if low[0] == '[' else '>'} {low[1:]}"


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
    schema = read_schema(root)
    return document(schema, checked(yaml.safe_load((root / "config/config.yaml").read_text(encoding="utf-8")), schema))


def columns_page() -> str:
    """Markdown page of the columns of every table that a study makes; what is alike stands once."""
    lines = [
        "# Columns of the tables",
        "",
        "Generated from the declarations that the tables are checked by, by `make docs`; do not edit. The twins of a "
        "table (`.md`, `.tex`, `.html`) show some of them. An empty cell: not measured, or without meaning there. "
        "`*` stands for each of the names in brackets. How distances are measured: [metrics.md](metrics.md).",
    ]
    explained, sizes = {}, {}
    for name, (module, declared, about) in TABLES.items():
        columns = getattr(import_module(module), declared)
        homes = {column.name: explained.get(_said_of(column), name) for column in columns}
        lines += ["", f"## {name}", "", f"{about[0].upper()}{about[1:]}."]
        for home in dict.fromkeys(homes.values()):
            shared = [column for column, other in homes.items() if other == home != name]
            whole = len(shared) == sizes.get(home)
            if shared:
                lines[-1] += f" As in {home.split(',')[0]}: {'all its columns' if whole else ', '.join(shared)}."
        table = [column for column in columns if homes[column.name] == name]
        lines += ["", "| column | meaning |", "|---|---|", *_column_rows(table)]
        explained, sizes[name] = {_said_of(column): name for column in columns} | explained, len(columns)
    return "\n".join(lines) + "\n"


def rules_page(said: str) -> str:
    """Markdown page of the graph that `snakemake --rulegraph mermaid-js` has drawn, in an order that lasts."""
    names = dict(re.findall(r"^\t(id\d+)\[(\w+)\]$", said, re.M))
    edges = {(names[first], names[then]) for first, then in re.findall(r"^\t(id\d+) --> (id\d+)$", said, re.M)}
    lines = [
        "# The rules of a study",
        "",
        "Drawn by Snakemake from the rules of the default study, by `make docs`; do not edit. An arrow leads to a rule "
        "that reads what the other makes.",
        "",
        "```mermaid",
        "flowchart TB",
        *(f"    {first}-->{then}" for first, then in sorted(edges) if first != then),
        "```",
    ]
    return "\n".join(lines) + "\n"


def _said_of(column: Column) -> tuple[str, str, str]:
    return column.name, column.unit, column.description


def _column_rows(columns: Sequence[Column]) -> Iterator[str]:
    """One row for each group of columns that mean the same, or the same of several things."""
    readings = {column.name: [("", column.unit, column.description, ""), *_patterns(column)] for column in columns}
    often = Counter(reading[:3] for each in readings.values() for reading in each)
    groups: dict[tuple, list[str]] = {}
    for column in columns:
        alike = [each for each in readings[column.name] if often[each[:3]] > 1] or readings[column.name][:1]
        *reading, stem = max(alike, key=lambda each: (often[each[:3]], len(each[3])))
        groups.setdefault(tuple(reading), []).append(stem or column.name)
    for (name, unit, description), members in groups.items():
        shown = f"`{name}` ({', '.join(members)})" if name else f"`{', '.join(members)}`"
        yield f"| {shown}{f' [{unit}]' if unit else ''} | {description.replace('|', '/')} |"


def _patterns(column: Column) -> Iterator[tuple[str, str, str, str]]:
    """Name, unit and description with `*` for a part of the name that the description repeats, and that part."""
    parts = column.name.split("_")
    for start, end in combinations(range(len(parts) + 1), 2):
        stem = "_".join(parts[start:end])
        said = re.compile(rf"\b({stem}|{stem.replace('_', ' ')})\b")
        if end - start < len(parts) and said.search(column.description):
            name = "_".join([*parts[:start], "*", *parts[end:]])
            yield name, column.unit, said.sub("*", column.description), stem


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
    (ROOT / "docs/reference/columns.md").write_text(columns_page(), encoding="utf-8")
    drawn = [sys.executable, "-m", "snakemake", "--rulegraph", "mermaid-js"]
    said = subprocess.run(drawn, cwd=ROOT, stdout=subprocess.PIPE, text=True, check=True).stdout
    (ROOT / "docs/reference/rules.md").write_text(rules_page(said), encoding="utf-8")
    config = ROOT / "config/config.yaml"
    text = commented(config.read_text(encoding="utf-8"), read_schema(ROOT))
    config.write_text(text, encoding="utf-8")
