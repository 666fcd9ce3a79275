"""What predicts a new patient: the one place where method, corrections and models are chosen."""

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from pinnochio.errors import InputError
from pinnochio.json_text import parse_stored_json
from pinnochio.manifest import MANIFEST
from pinnochio.methods.registry import BUILT_IN
from pinnochio.overlays import overlaid
from pinnochio.patients.model_archive import RANGES, READ_BY_NETWORKS, Archive, calibration_file, network_file

WITHOUT_MODELS = [method.name for method in BUILT_IN if method.new_patients and method.trains == "no"]


@dataclass(frozen=True)
class Choice:
    """method and the Newton corrections of its network's fields; settings: the sections READ_BY_NETWORKS.

    Of a learned method also lift, the kind that its network wants; the archive and its folder; networks, one of each
    fold in the order of archive.folds; calibration and ranges. These are plain files: no rule makes them.
    expected: the limits for the measured Pareto front, what it offered, and the seconds and errors to expect.
    """

    method: str
    settings: Mapping[str, Mapping]
    corrections: int = 0
    lift: str = "none"
    archive: Archive | None = None
    folder: str | None = None
    networks: Sequence[str] = ()
    calibration: str | None = None
    ranges: str | None = None
    expected: Mapping[str, object] | None = None

    @property
    def files(self) -> list[str]:
        """What a certificate reads of the archive."""
        named = (MANIFEST, RANGES, calibration_file(self.method))
        return [str(Path(self.folder) / name) for name in named] if self.folder else []


def choose(config: Mapping, models: str | os.PathLike, pareto_front: str | os.PathLike) -> Choice:
    """The choice of a configuration; models: folder of the archive; pareto_front: tradeoff.csv.

    With a budget in `predict` the Pareto front offers the setting, else it is predict.method as in the study. A learned
    method is used as it was trained: with the settings of the archive, not with those of `config` but for its accuracy.
    InputError where the archive is missing, lacks the method or knows fewer segments, where there is no
    Pareto front, or where nothing on it keeps what is asked.
    """
    # Absolute, so that no rule of the study makes these files: a prediction never starts a training.
    folder, wanted = Path(models).resolve(), config["predict"]
    if wanted["budget_seconds"]:
        return _offered(config, folder, pareto_front)
    return _as_in_the_study(config, folder, wanted["method"])


def _offered(config: Mapping, folder: Path, pareto_front: str | os.PathLike) -> Choice:
    """What the Pareto front offers among the methods that need no models and those of the archive, if there is one."""
    from pinnochio.columns import read_table  # these take a second, which other choices are spared
    from pinnochio.patients.pareto_front import TRADEOFF, choose_setting

    if not Path(pareto_front).is_file():
        raise InputError(
            "-",
            pareto_front,
            "there is no measured Pareto front to choose from",
            "measure it (snakemake tradeoff), name it in predict.pareto_front, or set no budget",
        )
    frame = read_table(pareto_front, TRADEOFF)
    archive = Archive.read(folder) if (folder / MANIFEST).is_file() else None
    method = frame["recipe"].map(lambda text: parse_stored_json(text, pareto_front)["method"] if text else "")
    learned = method.isin(list(archive.methods) if archive else [])
    frame["recipe"] = frame["recipe"].where(learned | method.isin(WITHOUT_MODELS), "")
    # The networks of all folds predict a new patient; the Pareto front was measured with one.
    times = ["seconds", "seconds_max"]
    frame.loc[learned, times] *= len(archive.folds) if archive else 1
    budget = config["predict"]["budget_seconds"]
    row = choose_setting(frame, budget)
    recipe = parse_stored_json(row["recipe"], pareto_front)
    choice = _as_in_the_study(config, folder, recipe["method"])
    setting = f"{row['method']}, {row['parameter']} {row['value']}"
    expected = {"budget_seconds": budget, "setting": setting, "patients": int(row["n"])}
    errors = ["cd", "cd_within", "face_error"]  # not known: the second of few patients, the last without a reference
    expected |= row[[*times, *errors]].dropna().astype(float).to_dict()
    settings = overlaid(choice.settings, {"mesh": {"nodes": recipe["nodes"]}, "fem": recipe["fem"]})
    return replace(choice, settings=settings, corrections=recipe["corrections"] or 0, expected=expected)


def _as_in_the_study(config: Mapping, folder: Path, method: str) -> Choice:
    if method in WITHOUT_MODELS:
        return Choice(method, {name: config[name] for name in READ_BY_NETWORKS})
    archive = Archive.read(folder)
    if method not in archive.methods:
        raise InputError(
            "-",
            folder,
            f"the archive has no {method!r}, but {', '.join(archive.methods)}",
            f"choose predict.method among these, or add {method!r} to uncertainty.methods and pack the study again",
        )
    strange = [name for name in config["segments"] if name not in archive.segments]
    if strange and config["predict"]["other_segments"] == "refuse":
        raise InputError(
            "-",
            "configuration",
            f"'segments' names {', '.join(strange)}, and the models were trained with {', '.join(archive.segments)}",
            "label and name them so, or set predict.other_segments to 'predict'; the certificate then says that the "
            "patient is unlike the training",
        )
    trained = archive.methods[method]
    return Choice(
        method=method,
        settings=overlaid(archive.settings, {"fem": {"accuracy": config["fem"]["accuracy"]}}),
        corrections=trained["corrections"],
        lift=trained["lift"],
        archive=archive,
        folder=str(folder),
        networks=[str(folder / network_file(method, fold)) for fold in archive.folds],
        calibration=str(folder / calibration_file(method)),
        ranges=str(folder / RANGES),
    )
