"""JSON read strictly: what the standard leaves to the reader and the reader to chance is an InputError."""

import json
import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import fields
from difflib import get_close_matches
from pathlib import Path
from typing import TypeVar

from pinnochio.errors import REMEDY, InputError, Refuse, refusal
from pinnochio.files import replacing

Kind = TypeVar("Kind")  # a dataclass
LARGEST = 1e300  # so that squares of what is read with others still mean something


def read_json(path: str | os.PathLike, refuse: Refuse):
    """What the file holds; refuse(problem, remedy) where it is no strict JSON in UTF-8."""
    return parse_json(read_text(path, refuse), refuse)


def read_text(path: str | os.PathLike, refuse: Refuse) -> str:
    """The text of a file in UTF-8, without its byte-order mark."""
    try:
        return Path(path).read_bytes().decode("utf-8-sig")
    except OSError as error:
        refuse(f"it cannot be read ({error.strerror})", "correct the path, or make the file readable")
    except UnicodeDecodeError as error:
        refuse(f"it is no text in UTF-8 (byte {error.start})", "save it as UTF-8")


def write_json(path: str | os.PathLike, content, **options) -> None:
    """Write what :func:`read_stored_json` reads; options: those of json.dumps."""
    with replacing(path) as temporary:
        temporary.write_text(json.dumps(content, indent=1, **options) + "\n", encoding="utf-8")


class StoredObject(dict):
    """An object in a JSON file that a stage wrote; to ask for a key that it lacks is an InputError."""

    file: object = "-"

    def __missing__(self, key):
        raise InputError("-", self.file, f"it holds no {key!r}", REMEDY)

    def of(self, kind: type[Kind]) -> Kind:
        """The dataclass whose fields are keys."""
        return kind(**{item.name: self[item.name] for item in fields(kind)})


def read_stored_json(path: str | os.PathLike) -> StoredObject:
    """The object in a JSON file that a stage wrote; InputError where it is damaged."""
    return parse_stored_json(read_text(path, refusal("-", path, REMEDY)), path)


def parse_stored_json(text: str, file: object) -> StoredObject:
    """The object that a text in a file that a stage wrote holds; InputError where it is damaged."""
    refuse = refusal("-", file, REMEDY)

    def make(pairs):
        made = StoredObject(pairs)
        made.file = file
        return made

    read = parse_json(text, refuse, finite=False, make=make)
    return read if isinstance(read, StoredObject) else refuse("it holds no object", REMEDY)


def read_stored_text(path: str | os.PathLike) -> str:
    """The lines of a text that a stage wrote, CSV too; InputError where the last one does not end."""
    refuse = refusal("-", path, REMEDY)
    text = read_text(path, refuse)
    return text if text.endswith("\n") else refuse("it is cut off" if text else "it is empty", REMEDY)


def parse_json(text: str, refuse: Refuse, finite: bool = True, make: Callable = dict):
    """What the text holds; keys that stand twice are refused and, if asked, NaN, infinity and numbers beyond 1e300.

    make(pairs) makes an object of its keys and values.
    """

    def once(pairs):
        read = make(pairs)
        if len(read) < len(pairs):
            keys = [key for key, _ in pairs]
            twice = next(key for key in keys if keys.count(key) > 1)
            refuse(f"{twice!r} stands twice", "keep one of them")
        return read

    def number(digits: str):
        value = float(digits)
        if not abs(value) <= LARGEST:
            refuse(f"it holds {digits[:20]}, which is not finite", "write finite numbers")
        return value if any(sign in digits for sign in ".eEnNI") else int(digits)

    checks = dict.fromkeys(("parse_float", "parse_int", "parse_constant"), number) if finite else {}
    try:
        return json.loads(text, object_pairs_hook=once, **checks)
    except json.JSONDecodeError as error:
        refuse(f"is not JSON ({error})", "correct it there")
    except (RecursionError, ValueError) as error:
        if isinstance(error, InputError):
            raise
        refuse("is nested too deeply or holds a number too long", "write plain numbers, lists and objects")


def check_keys(entry: Mapping, known: tuple[str, ...], place: str, refuse: Refuse) -> None:
    """Refuse a key that is not known; the message names the nearest one."""
    for key in entry:
        if key not in known:
            refuse(f"{place}{key!r} is unknown{meant(key, known)}", f"use {', '.join(known)} only")


def meant(word: str, known: Mapping[str, str] | Sequence[str], cutoff: float = 0.5) -> str:
    """What a word that is not known may stand for, as the end of a sentence; of a mapping its value for that word."""
    near = get_close_matches(word, known, n=1, cutoff=cutoff)
    return f"; did you mean {(known[near[0]] if isinstance(known, Mapping) else near[0])!r}?" if near else ""


def numbers(value, *shape: int) -> bool:
    """Whether it is nested lists of numbers of this shape; true and false are none."""
    if not shape:
        return isinstance(value, int | float) and not isinstance(value, bool)
    return isinstance(value, list) and len(value) == shape[0] and all(numbers(item, *shape[1:]) for item in value)
