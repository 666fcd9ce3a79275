"""The archive of trained models: what a prediction of new patients needs of a finished study, and nothing else."""

import hashlib
import json
import os
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

from pinnochio.errors import InputError
from pinnochio.files import replacing
from pinnochio.json_text import read_own_json

MANIFEST = "archive.json"
RANGES = "ranges.json"
OWN = "sha256"  # of the manifest, without itself
# Sections of the configuration that say what the networks read; a patient is made with those of the archive.
READ_BY_NETWORKS = ("mesh", "interfaces", "fem", "lift")


@dataclass(frozen=True)
class Archive:
    """What stands in the manifest.

    cohort, patients: what the models were trained on; segments: those that its patients could have; folds: names of
    the models of each method; methods: by name, the Newton corrections after the network (`corrections`) and the
    smallest, middle and largest value of some metrics on held-out patients (`usual`); settings: the sections
    READ_BY_NETWORKS;
    configuration, code: hashes of the whole configuration and of the library.
    """

    cohort: str
    patients: int
    segments: Sequence[str]
    folds: Sequence[str]
    methods: Mapping[str, Mapping]
    settings: Mapping[str, Mapping]
    configuration: str
    code: str

    def write(self, folder: str | os.PathLike) -> None:
        """Write the manifest, with the SHA-256 of every file that lies in the folder and of the manifest itself."""
        files = sorted(path for path in Path(folder).rglob("*") if path.is_file() and path.name != MANIFEST)
        content = asdict(self) | {
            "files": {path.relative_to(folder).as_posix(): _digest(path.read_bytes()) for path in files}
        }
        content[OWN] = _digest(json.dumps(content, sort_keys=True).encode())
        with replacing(Path(folder) / MANIFEST) as temporary:
            temporary.write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")

    @classmethod
    def read(cls, folder: str | os.PathLike) -> "Archive":
        """Read the manifest of an archive; InputError where the folder is none, or a file is not as it was packed."""
        if not (Path(folder) / MANIFEST).is_file():
            raise InputError(
                "-",
                folder,
                f"there is no archive of trained models ({MANIFEST})",
                "point 'models' at an archive, or make one (snakemake archive): that runs the study first, by default "
                "about 700 jobs in two hours on two cores, with config/quick.yaml about 150 in some minutes",
            )
        content = read_own_json(Path(folder) / MANIFEST)
        remedy = "copy the archive again from where it was packed, or pack it again (snakemake archive)"
        if not isinstance(content, dict) or OWN not in content:
            raise InputError("-", folder, f"{MANIFEST} holds no checksums", remedy)
        own = content.pop(OWN)
        files = content.get("files", {})
        if own != _digest(json.dumps(content, sort_keys=True).encode()):
            raise InputError("-", Path(folder) / MANIFEST, "it is not as it was packed", remedy)
        del content["files"]
        for name, digest in files.items():
            path = Path(folder) / name
            if not path.is_file():
                raise InputError("-", path, "the archive lacks this file", remedy)
            if _digest(path.read_bytes()) != digest:
                raise InputError("-", path, "it is not as it was packed: it is damaged or exchanged", remedy)
        return cls(**content)


def _digest(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()


def network_file(method: str, fold: str) -> str:
    """Place of a network in the archive."""
    return f"{method}/{fold}.pt"


def calibration_file(method: str) -> str:
    """Place of a method's calibration in the archive."""
    return f"{method}/calibration.json"


def configuration_hash(config: Mapping) -> str:
    """Short content hash of a configuration, whatever the order of its keys."""
    return hashlib.sha256(json.dumps(config, sort_keys=True).encode()).hexdigest()[:12]
