"""The archive of trained models: what a prediction of new patients needs of a finished study, and nothing else."""

import hashlib
import json
import os
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass

from pinnochio.errors import InputError
from pinnochio.manifest import CHECKSUM, MANIFEST, read_manifest, write_manifest

RANGES = "ranges.json"
FALLBACK = "fem_sliding"  # what predicts a patient or plan unlike the networks' training
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
        write_manifest(folder, asdict(self))

    @classmethod
    def read(cls, folder: str | os.PathLike) -> "Archive":
        """Read the manifest of an archive; InputError where the folder is none, or a file is not as it was packed."""
        absent = (
            f"there is no archive of trained models ({MANIFEST})",
            "point 'models' at an archive, or make one (snakemake archive): that runs the study first, by default "
            "about 700 jobs in two hours on two cores, with config/quick.yaml about 150 in some minutes",
        )
        content = read_manifest(
            folder, absent, "copy the archive again from where it was packed, or pack it again (snakemake archive)"
        )
        values = {name: value for name, value in content.items() if name not in ("files", CHECKSUM)}
        try:
            return cls(**values)
        except TypeError as error:
            problem = f"{MANIFEST} is not that of models for new patients ({error})"
            raise InputError("-", folder, problem, absent[1]) from error


def network_file(method: str, fold: str) -> str:
    """Place of a network in the archive."""
    return f"{method}/{fold}.pt"


def calibration_file(method: str) -> str:
    """Place of a method's calibration in the archive."""
    return f"{method}/calibration.json"


def configuration_hash(config: Mapping) -> str:
    """Short content hash of a configuration, whatever the order of its keys."""
    return hashlib.sha256(json.dumps(config, sort_keys=True).encode()).hexdigest()[:12]
