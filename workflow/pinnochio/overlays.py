"""Settings laid over others, and what differs between two."""

from collections.abc import Mapping, Sequence


def overlaid(base: Mapping, overlay: Mapping) -> dict:
    """`base` with the values of `overlay` in place of its own, mapping by mapping."""
    merged = dict(base)
    for key, value in overlay.items():
        merged[key] = overlaid(merged.get(key, {}), value) if isinstance(value, Mapping) else value
    return merged


def changes(base: Mapping, other: Mapping, prefix: str = "") -> Sequence[str]:
    """What differs between two settings, as "key value" in words; keys of nested mappings are joined by dots."""
    changed = []
    for key in sorted({*base, *other}):
        one, two = base.get(key), other.get(key)
        if isinstance(one, Mapping) and isinstance(two, Mapping):
            changed += changes(one, two, f"{prefix}{key}.")
        elif one != two:
            changed.append(f"{prefix}{key} {two}")
    return changed
