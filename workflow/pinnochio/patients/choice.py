"""What predicts a new patient: the one place where method, corrections and models are chosen."""

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from pinnochio.errors import InputError
from pinnochio.patients.archive import MANIFEST, RANGES, READ_BY_NETWORKS, Archive, calibration_file, network_file

WITHOUT_MODELS = ("elastic", "fem_bonded", "fem_sliding")


@dataclass(frozen=True)
class Choice:
    """method and the Newton corrections of its network's fields; settings: the sections READ_BY_NETWORKS.

    Of a learned method also lift, the kind that its network wants; the archive and its folder; networks, one of each
    fold in the order of archive.folds; calibration. These are plain files: no rule makes them.
    """

    method: str
    settings: Mapping[str, Mapping]
    corrections: int = 0
    lift: str = "none"
    archive: Archive | None = None
    folder: str | None = None
    networks: Sequence[str] = ()
    calibration: str | None = None

    @property
    def files(self) -> list[str]:
        """What a certificate reads of the archive."""
        named = (MANIFEST, RANGES, calibration_file(self.method))
        return [str(Path(self.folder) / name) for name in named] if self.folder else []


def choose(config: Mapping, models: str | os.PathLike) -> Choice:
    """The choice of a configuration; models: folder of the archive.

    A learned method is used as it was trained: with the settings of the archive, not with those of `config`.
    InputError where the archive is missing, lacks the method or was trained with other segments.
    """
    method = config["predict"]["method"]
    if method in WITHOUT_MODELS:
        return Choice(method, {name: config[name] for name in READ_BY_NETWORKS})
    # Absolute, so that no rule of the study makes these files: a prediction never starts a training.
    folder = Path(models).resolve()
    archive = Archive.read(folder)
    if method not in archive.methods:
        raise InputError(
            "-",
            folder,
            f"the archive has no {method!r}, but {', '.join(archive.methods)}",
            f"choose predict.method among these, or add {method!r} to uncertainty.methods and pack the study again",
        )
    if set(archive.segments) != set(config["segments"]) and config["predict"]["other_segments"] == "refuse":
        raise InputError(
            "-",
            "configuration",
            f"'segments' are {', '.join(config['segments'])}, the models were trained with "
            f"{', '.join(archive.segments)}",
            "label and name them so, or set predict.other_segments to 'predict'; the certificate then says that the "
            "patient is unlike the training",
        )
    own = archive.methods[method]
    networks = [str(folder / network_file(method, fold)) for fold in archive.folds]
    calibration = str(folder / calibration_file(method))
    return Choice(
        method, archive.settings, own["corrections"], own["lift"], archive, str(folder), networks, calibration
    )
