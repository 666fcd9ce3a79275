"""Settings laid over others, and what differs between two."""

import os
from collections.abc import Iterable, Iterator, Mapping
from functools import reduce
from pathlib import Path
from typing import Any

import yaml


def overlaid(base: Mapping, overlay: Mapping) -> dict:
    """`base` with the values of `overlay` in place of its own, mapping by mapping."""
    merged = dict(base)
    for key, value in overlay.items():
        merged[key] = overlaid(merged.get(key, {}), value) if isinstance(value, Mapping) else value
    return merged


def read_merged(paths: Iterable[str | os.PathLike]) -> dict:
    """The first YAML file with the values of the others over its own, as `--configfile` puts them."""
    return reduce(overlaid, (yaml.safe_load(Path(path).read_text(encoding="utf-8")) for path in paths))


def differences(base: Mapping, other: Mapping, prefix: str = "") -> Iterator[tuple[str, Any]]:
    """What differs between two settings: name, keys of nested mappings joined by dots, and value in `other`."""
    for key in sorted({*base, *other}):
        one, two = base.get(key), other.get(key)
        if isinstance(one, Mapping) and isinstance(two, Mapping):
            yield from differences(one, two, f"{prefix}{key}.")
        elif one != two:
            yield f"{prefix}{key}", two


def changes(base: Mapping, other: Mapping) -> list[str]:
    """The same as "key value" in words."""
    return [f"{name} {value}" for name, value in differences(base, other)]
