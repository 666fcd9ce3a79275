"""What the planner works with: a prepared patient and the models that predict it."""

import os
from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields
from pathlib import Path

from pinnochio.errors import InputError
from pinnochio.json_text import read_stored_json, write_json


@dataclass(frozen=True)
class Prepared:
    """A patient and its models: files and settings, as the rule `prepare_planner` writes them.

    model, skin, bone, lift (None for networks without one), quality: files of the patient; plans: checked
    plan files by name; home: folder that plans are saved in; archive: folder of the models; method, corrections, fem:
    what predicts, and how; invert: how wishes are answered, the section of the configuration; scan: how a scan is
    registered.
    """

    case: str
    model: str
    lift: str | None
    quality: str
    plans: Mapping[str, str]
    home: str
    archive: str
    method: str
    corrections: int
    fem: Mapping[str, object]
    invert: Mapping[str, object]
    skin: str
    bone: str
    scan: Mapping[str, float]

    def write(self, path: str | os.PathLike) -> None:
        """Write as JSON."""
        write_json(path, asdict(self))

    @classmethod
    def read(cls, path: str | os.PathLike) -> "Prepared":
        """Read what :meth:`write` wrote; InputError where it, or a file that it names, is not there."""
        remedy = "prepare the patient: make planner PATIENT=FOLDER"
        if not Path(path).is_file():
            raise InputError("-", path, "no patient is prepared for the planner", remedy)
        content = read_stored_json(path)
        if content.keys() != {item.name for item in fields(cls)}:
            raise InputError("-", path, "it is not what this version prepares", remedy)
        prepared = cls(**content)
        files = [prepared.model, prepared.lift, prepared.quality, prepared.archive]
        files += [prepared.skin, prepared.bone]
        files += prepared.plans.values()
        for file in filter(None, files):
            if not Path(file).exists():
                raise InputError(prepared.case, file, "it is no longer there", remedy)
        return prepared
