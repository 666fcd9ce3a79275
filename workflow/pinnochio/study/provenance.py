"""Whether results that lie there were made with another configuration, where Snakemake cannot know."""

import json
import os
from base64 import urlsafe_b64encode
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from pinnochio.errors import InputError
from pinnochio.json_text import read_stored_json
from pinnochio.overlays import differences

# They say where files lie and who is predicted or shown, not how results are made.
PLACES = ("pathvars", "patient", "models", "predict", "report")


def forgotten(provenance: str | os.PathLike, working_directory: str | os.PathLike = ".") -> bool:
    """Whether the record of a study lies there while Snakemake has no metadata of it.

    Snakemake 9 compares the parameters, the inputs and the code of a job with what `.snakemake/metadata` has of its
    outputs, in a file named by the URL-safe base64 of the path. Without that file only the times of the files count: a
    dry run says "jobs have missing provenance/metadata", and results of another configuration stand as up to date.
    """
    metadata = Path(working_directory, ".snakemake/metadata", urlsafe_b64encode(os.fsencode(provenance)).decode())
    return Path(working_directory, provenance).is_file() and not metadata.is_file()


def changed_since(provenance: str | os.PathLike, config: Mapping[str, Any]) -> list[str]:
    """The keys, nested ones joined by dots, that differ from the configuration in a `provenance.json`."""
    recorded = read_stored_json(provenance).get("config")
    if not isinstance(recorded, dict):
        raise InputError("-", provenance, "it holds no configuration", "delete it, or the results folder that it is in")
    one, other = ({key: each[key] for key in each if key not in PLACES} for each in (recorded, config))
    return [name for name, _ in differences(one, json.loads(json.dumps(other)))]
