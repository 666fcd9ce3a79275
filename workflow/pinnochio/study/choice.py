"""What predicts a new patient: the one place where method, corrections and models are chosen."""

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from pinnochio.errors import InputError
from pinnochio.manifest import MANIFEST
from pinnochio.methods.registry import BUILT_IN
from pinnochio.overlays import overlaid
from pinnochio.patients.model_archive import FALLBACK, RANGES, READ_BY_NETWORKS, Archive, calibration_file, network_file

# Nodes -> mean distance (mm) of the face by sliding finite elements from that on 30,000 (docs/lab/tradeoff.md).
MESH_ERROR = {1500: 0.6, 3000: 0.4, 5000: 0.26, 10000: 0.15, 20000: 0.1}
WITHOUT_MODELS = [method.name for method in BUILT_IN if method.new_patients and method.trains == "no"]


@dataclass(frozen=True)
class Choice:
    """method and the Newton corrections of its network's fields; settings: the sections READ_BY_NETWORKS; seconds: of
    a plan, within which the method that comes nearest is chosen on the patient (`patients.front`).

    Of a learned method also lift, the kind that its network wants; the archive and its folder; networks, one of each
    fold in the order of archive.folds. These are plain files: no rule makes them.
    """

    method: str
    settings: Mapping[str, Mapping]
    corrections: int = 0
    lift: str = "none"
    archive: Archive | None = None
    folder: str | None = None
    networks: Sequence[str] = ()
    seconds: float | None = None

    @property
    def in_words(self) -> str:
        """Which models predict, or of finite elements how near the mesh lets them come."""
        about, nodes = self.archive, self.settings["mesh"]["nodes"]
        if about:
            return f"Models: {self.folder}, trained on {about.patients} patients ({about.cohort})."
        if not self.method.startswith("fem"):
            return ""
        error, finest = MESH_ERROR[min(MESH_ERROR, key=lambda known: abs(known - nodes))], max(MESH_ERROR)
        finer = f"; mesh.nodes: {finest} brings {MESH_ERROR[finest]:g} mm in ten times the seconds" * (nodes < finest)
        return (
            f"Finite elements on {nodes} nodes: whatever the accuracy, the face is some {error:g} mm from that of a "
            f"fine mesh, more at the lips{finer}."
        )

    @property
    def files(self) -> list[str]:
        """What a certificate reads of the archive, or the choice by seconds of the front."""
        if self.seconds:
            from pinnochio.patients.front import FRONT  # half a second, which other choices are spared

            return [str(FRONT)]
        if not self.folder:
            return []
        named = [Path(self.folder) / name for name in (MANIFEST, RANGES, calibration_file(self.method))]
        other = Path(self.folder) / calibration_file(FALLBACK)
        return [str(path) for path in named] + [str(other)] * other.is_file()


def choose(config: Mapping, models: str | os.PathLike) -> Choice:
    """The choice of a configuration: predict.method; models: folder of the archive.

    A learned method is used as it was trained: with the settings of the archive, not with those of `config` but for its
    accuracy. predict.accuracy or predict.seconds choose finite elements in its place. InputError where both are there,
    or the archive is missing, lacks the method or knows fewer segments.
    """
    method, dial = config["predict"]["method"], {name: config["predict"].get(name) for name in ("accuracy", "seconds")}
    if None not in dial.values():
        raise InputError("-", "configuration", "predict has both accuracy and seconds", "keep one of the two")
    if any(dial.values()):
        accuracy = dial["accuracy"] or config["fem"]["accuracy"]
        settings = overlaid({name: config[name] for name in READ_BY_NETWORKS}, {"fem": {"accuracy": accuracy}})
        return Choice(FALLBACK, settings, seconds=dial["seconds"])
    if method in WITHOUT_MODELS:
        return Choice(method, {name: config[name] for name in READ_BY_NETWORKS})
    # Absolute, so that no rule of the study makes these files: a prediction never starts a training.
    folder = Path(models).resolve()
    archive = Archive.read(folder)
    if method not in archive.methods:
        problem = f"the archive has no {method!r}, but {', '.join(archive.methods)}"
        other = f"add {method!r} to uncertainty.methods and pack the study again"
        raise InputError("-", folder, problem, f"choose predict.method among these, or {other}")
    strange = [name for name in config["segments"] if name not in archive.segments]
    if strange and config["predict"]["other_segments"] == "refuse":
        known = ", ".join(archive.segments)
        problem = f"'segments' names {', '.join(strange)}, and the models were trained with {known}"
        remedy = "label and name them so, or set predict.other_segments to 'predict'; the certificate then says that "
        raise InputError("-", "configuration", problem, f"{remedy}the patient is unlike the training")
    trained = archive.methods[method]
    return Choice(
        method=method,
        settings=overlaid(archive.settings, {"fem": {"accuracy": config["fem"]["accuracy"]}}),
        corrections=trained["corrections"],
        lift=trained["lift"],
        archive=archive,
        folder=str(folder),
        networks=[str(folder / network_file(method, fold)) for fold in archive.folds],
    )
