"""JSON read strictly: what the standard leaves to the reader and the reader to chance is an InputError."""

import json
import os
from collections.abc import Callable, Mapping
from difflib import get_close_matches
from pathlib import Path

from pinnochio.errors import InputError

Refuse = Callable[[str, str], None]  # refuse(problem, remedy) raises InputError
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


def read_own_json(path: str | os.PathLike):
    """What a JSON file of the study's own holds; InputError where it is damaged."""

    def refuse(problem: str, remedy: str):
        raise InputError("-", path, problem, "delete it and run the same command again; of an archive, copy it again")

    return parse_json(read_text(path, refuse), refuse, finite=False)


def parse_json(text: str, refuse: Refuse, finite: bool = True):
    """What the text holds; keys that stand twice are refused and, if asked, NaN, infinity and numbers beyond 1e300."""

    def once(pairs):
        read = dict(pairs)
        if len(read) < len(pairs):
            keys = [key for key, _ in pairs]
            twice = next(key for key in keys if keys.count(key) > 1)
            refuse(f"{twice!r} stands twice", "keep one of them")
        return read

    def number(digits: str):
        value = float(digits)
        if finite and not abs(value) <= LARGEST:
            refuse(f"it holds {digits[:20]}, which is not finite", "write finite numbers")
        return value if any(sign in digits for sign in ".eEnNI") else int(digits)

    try:
        return json.loads(
            text,
            object_pairs_hook=once,
            parse_float=number,
            parse_int=number,
            parse_constant=number,
        )
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
            near = get_close_matches(key, known, n=1, cutoff=0.5)
            meant = f"; did you mean {near[0]!r}?" if near else ""
            refuse(f"{place}{key!r} is unknown{meant}", f"use {', '.join(known)} only")
