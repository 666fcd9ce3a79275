"""A configuration checked against its schema: text is read as YAML reads it, and what is wrong is said by key.

Snakemake lays a nested value of `--config` over the section of the file, but reads it without types: the number of
`fem="{poisson: 0.45}"` arrives as the text "0.45". PyYAML reads 1e-6 as text, from a file too. So the schema says what
a text stands for.
"""

import os
import re
from collections.abc import Iterator, Mapping, Sequence
from difflib import get_close_matches
from functools import reduce
from operator import getitem
from pathlib import Path
from textwrap import shorten
from typing import Any

import yaml
from jsonschema import Draft202012Validator, ValidationError

from pinnochio.errors import InputError

BOOLEANS = {text: word == "true" for word in ("true", "false") for text in (word, word.title(), word.upper())}
INTEGER = re.compile(r"[-+]?\d+")
NUMBER = re.compile(r"[-+]?((\d+\.?\d*|\.\d+)(e[-+]?\d+)?|\.?inf|\.?nan)", re.IGNORECASE)
BOUNDS = {"minimum": ">=", "exclusiveMinimum": ">", "maximum": "<=", "exclusiveMaximum": "<"}
LARGEST = 1e300  # a number beyond it is taken for infinite
SECTIONS = "workflow/studies/*/schema.yaml"
SHOWN = 5  # wrong keys that are explained


def read_schema(folder: str | os.PathLike) -> dict:
    """The schema of a study's configuration: workflow/schemas below the project's folder, and each study's section.

    A section's defaults stand in its schema, so that a configuration need not hold it.
    """
    core, *sections = [Path(folder, "workflow/schemas/config.schema.yaml"), *sorted(Path(folder).glob(SECTIONS))]
    schema = yaml.load(core.read_text(encoding="utf-8"), yaml.CSafeLoader)
    for path in sections:
        schema["properties"] |= yaml.load(path.read_text(encoding="utf-8"), yaml.CSafeLoader)
    return schema


def checked(config: Mapping, schema: Mapping) -> dict:
    """The configuration with the types and the defaults of its schema (JSON Schema 2020-12).

    InputError names each wrong key with its value, what is allowed, and the nearest known key.
    """
    validator = Draft202012Validator(schema)
    typed = _typed(config, schema, validator)
    lines = [f"{name} is {value}, which is not finite" for name, value in _not_finite(typed)]
    for error in sorted(validator.iter_errors(typed), key=lambda error: [str(part) for part in error.absolute_path]):
        lines += _explained(error, schema)
    if isinstance(config.get("patient"), int | float):
        lines.append("a patient whose name is a number is given with its folder: patient=./007")
    if lines:
        more = [f"and {len(lines) - SHOWN} more"] if len(lines) > SHOWN else []
        problem = "\n  ".join([*lines[:SHOWN], *more])
        raise InputError("-", "configuration", problem, "correct it; config/README.md explains every key")
    return typed


def refuse_doubled(file: str | os.PathLike) -> None:
    """InputError where a mapping of a configuration file (YAML, JSON) holds a key twice: the last would win unsaid."""
    left = [yaml.compose(Path(file).read_text(encoding="utf-8"), yaml.CSafeLoader)]
    while left:
        node = left.pop()
        if isinstance(node, yaml.SequenceNode):
            left += node.value
        if isinstance(node, yaml.MappingNode):
            lines = {}
            for key, value in node.value:
                line = key.start_mark.line + 1
                if key.value in lines:
                    problem = f"key {key.value!r} stands in lines {lines[key.value]} and {line}"
                    raise InputError("-", str(file), problem, "leave one of them")
                lines[key.value] = line
                left.append(value)


def allowed(entry: Mapping) -> str:
    """The values that an entry of the schema allows, in words."""
    if "oneOf" in entry:
        return " or ".join(allowed(part) for part in entry["oneOf"] if "$ref" not in part)
    if "const" in entry:
        return f"`{entry['const']}`"
    if "enum" in entry:
        return ", ".join(map(str, entry["enum"]))
    if "enum" in entry.get("items", {}):
        return "any of " + ", ".join(entry["items"]["enum"])
    words = [entry["type"] + (f" of {allowed(entry['items'])}" if "items" in entry else "")]
    return ", ".join(words + [f"{sign} {entry[bound]}" for bound, sign in BOUNDS.items() if bound in entry])


def resolved(entry: Mapping, schema: Mapping) -> dict:
    """An entry of the schema with what it refers to in `$defs`."""
    while "$ref" in entry:
        beside = {key: value for key, value in entry.items() if key != "$ref"}
        entry = reduce(getitem, entry["$ref"].removeprefix("#/").split("/"), schema) | beside
    return dict(entry)


def _typed(value: Any, entry: Mapping, validator: Draft202012Validator) -> Any:
    """The value with its text read as the entry asks, and with the entry's defaults."""
    entry = resolved(entry, validator.schema)
    if options := entry.get("oneOf"):
        readings = [_typed(value, option, validator) for option in options]
        each = zip(readings, options, strict=True)
        valid = [read for read, option in each if validator.evolve(schema=option).is_valid(read)]
        return [*valid, *(read for read in readings if read != value), value][0]
    if isinstance(value, Mapping):
        named = {str(key): item for key, item in value.items()}  # YAML knows keys that are numbers, or nothing
        items = {key: _typed(item, _child(entry, key, validator.schema), validator) for key, item in named.items()}
        known = entry.get("properties", {}).items()
        absent = {key: part for key, part in known if "default" in part and key not in value}
        return {key: _typed(part["default"], part, validator) for key, part in absent.items()} | items
    if isinstance(value, Sequence) and not isinstance(value, str):
        return [_typed(item, entry.get("items", {}), validator) for item in value]
    kind = entry.get("type")
    if kind == "integer" and isinstance(value, float) and value.is_integer():
        return int(value)
    if not isinstance(value, str):
        return value
    if kind == "array" and value.startswith("[") and value.endswith("]"):
        return _typed(yaml.load(value, yaml.BaseLoader), entry, validator)
    if kind in ("integer", "number") and INTEGER.fullmatch(value):
        return int(value)
    if kind == "number" and NUMBER.fullmatch(value):
        return float(re.sub(r"\.(?=inf|nan)", "", value.lower()))
    return BOOLEANS.get(value, value) if kind == "boolean" else value


def _child(entry: Mapping, key: str | int, schema: Mapping) -> dict:
    """The entry of a key, or of an index, below an entry; empty if there is none."""
    entry = resolved(entry, schema)
    for option in (resolved(option, schema) for option in entry.get("oneOf", ())):
        entry = option if "properties" in option else entry
    others = entry.get("items" if isinstance(key, int) else "additionalProperties")
    return entry.get("properties", {}).get(key) or (others if isinstance(others, Mapping) else {})


def _entry(place: Sequence, schema: Mapping) -> dict:
    """The entry at a place."""
    entry = schema
    for key in place:
        entry = _child(entry, key, schema)
    return resolved(entry, schema)


def _not_finite(value: Any, place: tuple = ()) -> Iterator[tuple[str, str]]:
    """Name and value of each number that is not finite."""
    if isinstance(value, int | float) and not abs(value) <= LARGEST:
        yield _name(place), _short(value)
    elif isinstance(value, (Mapping, list)):
        for key, item in value.items() if isinstance(value, Mapping) else enumerate(value):
            yield from _not_finite(item, (*place, key))


def _explained(error: ValidationError, schema: Mapping) -> list[str]:
    """One line for each wrong key of an error: its name, its value, what is allowed."""
    if error.validator == "oneOf" and isinstance(error.instance, Mapping):
        return [line for part in error.context if part.validator != "const" for line in _explained(part, schema)]
    place, value = tuple(error.absolute_path), error.instance
    if isinstance(value, int | float) and not abs(value) <= LARGEST:
        return []
    entry = _entry(place, schema)
    if error.validator == "additionalProperties":
        unknown = [key for key in value if key not in error.schema["properties"]]
        return [_unknown((*place, key), value[key], error.schema["properties"], schema) for key in unknown]
    if error.validator == "required":
        missing = [(*place, key) for key in error.validator_value if key not in value]
        return [f"{_name(key)} is missing: {_meaning(_child(entry, key[-1], schema), schema)}" for key in missing]
    # `allowed` says the rest of these; of others jsonschema does: "[] is too short".
    explained = error.validator in {"type", "enum", "const", "oneOf", *BOUNDS}
    problem = f" is {_short(value)}" if explained else f": {shorten(error.message, 160)}"
    return [f"{_name(place)}{problem}; allowed: {_meaning(entry, schema)}"]


def _unknown(place: tuple, value: Any, siblings: Mapping, schema: Mapping) -> str:
    """The line of an unknown key, with the nearest known one: of its section, else of the same name elsewhere."""
    close, similar = (get_close_matches(place[-1], siblings, n=1, cutoff=cutoff) for cutoff in (0.8, 0.5))
    namesakes = sorted((known for known in _places(schema, schema) if known[-1] == place[-1]), key=len)
    hint = f"known are {', '.join(siblings)}"
    if near := [*((*place[:-1], key) for key in close), *namesakes, *((*place[:-1], key) for key in similar)]:
        hint = f"did you mean {_name(near[0])}: {_meaning(_entry(near[0], schema), schema)}"
    return f"{_name(place)} ({_short(value)}) is unknown; {hint}"


def _places(entry: Mapping, schema: Mapping, place: tuple = ()) -> Iterator[tuple]:
    """The place of every key with a name of its own."""
    for key in resolved(entry, schema).get("properties", {}):
        yield (*place, key)
        yield from _places(_child(entry, key, schema), schema, (*place, key))


def _meaning(entry: Mapping, schema: Mapping) -> str:
    """What the entry allows and, in brackets, what it stands for."""
    entry = resolved(entry, schema)
    return f"{allowed(entry)} ({entry.get('description', 'no description').rstrip('.')})"


def _name(place: Sequence) -> str:
    """A key by its path: `tradeoff.nodes[1]`."""
    return "".join(f"[{part}]" if isinstance(part, int) else f".{part}" for part in place).lstrip(".")


def _short(value: Any) -> str:
    return shorten(repr(value), 80, placeholder=" ...")
