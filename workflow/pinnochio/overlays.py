"""Settings laid over others, and what differs between two."""

from collections.abc import Iterator, Mapping
from typing import Any


def overlaid(base: Mapping, overlay: Mapping) -> dict:
    """`base` with the values of `overlay` in place of its own, mapping by mapping."""
    merged = dict(base)
    for key, value in overlay.items():
        merged[key] = overlaid(merged.get(key, {}), value) if isinstance(value, Mapping) else value
    return merged


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
