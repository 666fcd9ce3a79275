"""A folder whose manifest holds the SHA-256 of each of its files and of itself."""

import hashlib
import json
import os
from collections.abc import Mapping
from pathlib import Path

from pinnochio.errors import InputError
from pinnochio.json_text import read_stored_json, write_json

MANIFEST = "archive.json"
CHECKSUM = "sha256"  # of the manifest, without itself


def write_manifest(folder: str | os.PathLike, content: Mapping) -> None:
    """Write the manifest with this content and the SHA-256 of every file that lies in the folder and of itself."""
    files = sorted(path for path in Path(folder).rglob("*") if path.is_file() and path.name != MANIFEST)
    content = dict(content) | {
        "files": {path.relative_to(folder).as_posix(): digest(path.read_bytes()) for path in files}
    }
    content[CHECKSUM] = _checksum(content)
    write_json(Path(folder) / MANIFEST, content)


def read_manifest(folder: str | os.PathLike, absent: tuple[str, str], again: str) -> dict:
    """The content of a folder's manifest, with `files` and the SHA-256 of the manifest under CHECKSUM.

    InputError where there is none (absent: problem and remedy), or where it or a file is not as it was written; again:
    the remedy.
    """
    if not (Path(folder) / MANIFEST).is_file():
        raise InputError("-", folder, *absent)
    content = read_stored_json(Path(folder) / MANIFEST)
    if CHECKSUM not in content:
        raise InputError("-", folder, f"{MANIFEST} holds no checksums", again)
    if content[CHECKSUM] != _checksum({name: value for name, value in content.items() if name != CHECKSUM}):
        raise InputError("-", Path(folder) / MANIFEST, "it is not as it was packed", again)
    for name in content.get("files", {}):
        check_file(folder, content, name, again)
    return content


def check_file(folder: str | os.PathLike, content: Mapping, name: str, again: str) -> None:
    """InputError where the file of this name is not there or not as the manifest's content has it."""
    path = Path(folder) / name
    if not path.is_file():
        raise InputError("-", path, "the archive lacks this file", again)
    if digest(path.read_bytes()) != content["files"].get(name):
        raise InputError("-", path, "it is not as it was packed: it is damaged or exchanged", again)


def digest(content: bytes) -> str:
    """SHA-256."""
    return hashlib.sha256(content).hexdigest()


def _checksum(content: Mapping) -> str:
    return digest(json.dumps(content, sort_keys=True).encode())
