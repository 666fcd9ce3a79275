"""The archive of a study's trained networks, which a study of the same cohort and folds takes instead of training."""

import os
import shutil
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

from pinnochio.errors import InputError
from pinnochio.files import replacing
from pinnochio.manifest import MANIFEST, check_file, read_manifest, write_manifest
from pinnochio.training.settings import PHASES

# Sections of the configuration that decide what the networks were shown; a study takes networks of its own alone.
SHOWN = ("seed", "cohort", "virtual", "motion", "mesh", "interfaces", "fem", "fem_samples", "lift")
NETWORK = "network.pt"
HISTORIES = tuple(f"{phase}.csv" for phase in PHASES.values())
AGAIN = "fetch the archive again from where it was packed, or train the networks ('networks: train')"


@dataclass(frozen=True)
class NetworkArchive:
    """What stands in the manifest.

    held_out: patients that the networks of each fold have not seen; shown: the sections SHOWN of the configuration that
    they were trained under; methods: settings of network and phases by the method's name; provenance: where, when and
    by what they were trained, plain values. files: SHA-256 by name, {fold}/{method}/{network.pt, pretraining.csv,
    finetuning.csv}; sha256: of the manifest.
    """

    held_out: Mapping[str, Sequence[str]]
    shown: Mapping[str, object]
    methods: Mapping[str, Mapping]
    provenance: Mapping[str, object]
    files: Mapping[str, str]
    sha256: str

    @classmethod
    def read(cls, folder: str | os.PathLike) -> "NetworkArchive":
        """Read the manifest alone; InputError where the folder has none, or one that is not as it was packed."""
        absent = f"there is no archive of trained networks ({MANIFEST})", "name it in 'networks_archive', or train them"
        content = read_manifest(folder, absent, AGAIN, whole=False)
        if isinstance(content.get("shown"), dict) and content["shown"].get("virtual", {}).get("anatomy") == "scanned":
            del content["shown"]["virtual"]["anatomy"]  # older archives name the one anatomy that there is
        try:
            return cls(**content)
        except TypeError as error:
            problem = f"{MANIFEST} is not that of a study's networks ({error})"
            raise InputError("-", folder, problem, absent[1]) from error

    def refuse_others(self, folder: str | os.PathLike, shown: Mapping, held_out: Mapping[str, Sequence[str]]) -> None:
        """InputError unless the networks were trained on these folds, and under these values of the sections SHOWN:
        another fold's network may have seen the patient that it is judged on."""
        differ = [name for name in SHOWN if self.shown[name] != shown[name]]
        if {fold: list(cases) for fold, cases in held_out.items()} != self.held_out:
            differ.append("folds")
        if differ:
            raise InputError(
                "-",
                folder,
                f"its networks were trained under another configuration: {', '.join(differ)}",
                "set these as the archive has them, or train ('networks: train')",
            )


def pack(
    trained: str | os.PathLike,
    out: str | os.PathLike,
    methods: Mapping[str, Mapping],
    held_out: Mapping[str, Sequence[str]],
    shown: Mapping[str, object],
    provenance: Mapping[str, object],
) -> NetworkArchive:
    """Copy the networks and histories of methods from {trained}/{fold}/{method}/ and write the manifest last.

    InputError where a method lacks the network or a history of a fold. Settings of the phases come from `methods`, as
    the configuration that trained them has them.
    """
    for fold in held_out:
        for method, settings in methods.items():
            for name in (NETWORK, *(history for history in HISTORIES if Path(history).stem in settings)):
                source = Path(trained, fold, method, name)
                if not source.is_file():
                    raise InputError("-", source, "this file is not there", "train the network of this fold first")
                with replacing(Path(out, fold, method, name)) as temporary:
                    shutil.copyfile(source, temporary)
    content = {"held_out": held_out, "shown": {name: shown[name] for name in SHOWN}, "methods": methods}
    write_manifest(out, content | {"provenance": provenance})
    return NetworkArchive.read(out)


def take(folder: str | os.PathLike, names: Iterable[str], outputs: Iterable[str | os.PathLike]) -> None:
    """Copy files of the archive to the outputs, each if it is as it was packed."""
    content = asdict(NetworkArchive.read(folder))
    for name, output in zip(names, outputs, strict=True):
        check_file(folder, content, name, AGAIN)
        with replacing(output) as temporary:
            shutil.copyfile(Path(folder, name), temporary)
