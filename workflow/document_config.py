"""Makes config/README.md of the schema and the default configuration: `make docs`."""

from pathlib import Path

import yaml

from pinnochio.code import ROOT
from pinnochio.study.schema import allowed, resolved


def document(schema: dict, defaults: dict) -> str:
    """Markdown page with one row per key: default, bounds, meaning."""
    lines = [
        "# Configuration",
        "",
        "Generated from `workflow/schemas/config.schema.yaml` and `config/config.yaml` by `make docs`; do not edit.",
        "",
        schema["description"],
        'An overlay (`--configfile config/quick.yaml`), `--config seed=2` or `--config fem="{poisson: 0.45}"` replaces '
        "single values.",
        "",
        "| key | default | allowed | meaning |",
        "|---|---|---|---|",
    ]
    return "\n".join(lines + list(rows(schema, defaults, schema, ""))) + "\n"


def rows(node: dict, defaults: dict, schema: dict, prefix: str):
    """Table rows of an object's properties, depth first."""
    for key, entry in node["properties"].items():
        entry = resolved(entry, schema)
        meaning = entry.get("description", "")
        for part in entry.get("oneOf", []):
            if "$ref" in part:
                entry = resolved(part, schema)
        value = (defaults or {}).get(key)
        if "properties" in entry:
            yield f"| **`{prefix}{key}`** | | | {meaning} |"
            yield from rows(entry, value, schema, f"{prefix}{key}.")
        else:
            yield f"| `{prefix}{key}` | `{value}` | {allowed(entry)} | {meaning} |"


def config_page(root: Path = ROOT) -> str:
    """The page for the files of a checkout."""
    schema = yaml.safe_load((root / "workflow/schemas/config.schema.yaml").read_text(encoding="utf-8"))
    return document(schema, yaml.safe_load((root / "config/config.yaml").read_text(encoding="utf-8")))


if __name__ == "__main__":
    (ROOT / "config/README.md").write_text(config_page(), encoding="utf-8")
