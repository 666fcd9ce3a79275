"""The files of new patients: a segmentation and one or several plans each."""

import json
import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from pinnochio.errors import InputError
from pinnochio.files import check_name
from pinnochio.importing.cohort import COVARIATES, covariates_of, read_cases
from pinnochio.json_text import read_json
from pinnochio.volume_size import IMAGE_FORMATS

VOLUMES = ("volume", "ct", "cbct")  # names of the scan, before its ending
ENDING = ".mrk.json"
COVARIATES_FILE = "covariates.json"
WORDS = {"True": "yes", "False": "no"}  # of a cohort table for JSON's own
WISH = "wish"  # name of what is wished of the face, before its ending
WISHES = (ENDING, ".ply", ".stl", ".vtp", ".obj", ".csv", ".tsv")


@dataclass(frozen=True)
class NewPatient:
    """A patient to predict: segmentation, a file or a folder of surfaces; plan files or folders by the plan's name.

    home: the folder that what is planned for the patient is saved in; volume: the scan; markups: a file or folder of
    them; both empty where there is none. covariates: what else is known, by name; wishes: files that say how the face
    shall be.
    """

    name: str
    segmentation: str
    plans: Mapping[str, str]
    home: str
    volume: str = ""
    markups: str = ""
    covariates: Mapping[str, str | float | bool] = field(default_factory=dict)
    wishes: Sequence[str] = ()


def markups_in(folder: str | os.PathLike) -> list[str]:
    """The files of markups of the patient as it is; what is wished is none of them."""
    files = [path for path in sorted(Path(folder).iterdir()) if path.name.endswith(ENDING)]
    return [str(path) for path in files if not _is_wish(path)]


def read_patients(path: str | os.PathLike) -> dict[str, NewPatient]:
    """The patients by name: the one of a folder, or those of a table with the columns of a cohort table.

    A folder bears the patient's name and holds `segmentation.*` (or the folder `segmentation` of surfaces or of several
    images) and, unless there is no plan yet, `plan.json`, the folder `plan` of transforms, or `plans/` with several of
    either; a plan may be a second segmentation, after surgery. The scan is one of VOLUMES; markups (`.mrk.json`) and
    `covariates.json` lie beside it, and so does what is wished of the face, `wish.*`. In a table the plan may be such a
    folder of plans too; it has no wishes. InputError for what is missing or there twice.
    """
    path = Path(path)
    if os.path.isdir(path):  # a path that is too long is none
        patients = [_of_folder(path)]
    elif os.path.isfile(path):
        patients = [
            NewPatient(
                name=case.name,
                segmentation=case.segmentation,
                plans=_plans(case.name, case.plan),
                home=str(path.parent / case.name),
                volume=case.volume,
                markups=case.markups,
                covariates=case.covariates,
            )
            for case in read_cases(path)
        ]
    else:
        raise InputError("-", path, "there is no such folder or table", "name the patient's folder: patient=FOLDER")
    return {patient.name: patient for patient in patients}


def other_cases(patients: Iterable[NewPatient]) -> list[str]:
    """What is odd of plans that name another case than the patient that they lie with; what cannot be read is skipped,
    because importing it says why."""
    odd = []
    for patient in patients:
        for file in patient.plans.values():
            try:
                case = json.loads(Path(file).read_bytes().decode("utf-8-sig")).get("case", patient.name)
            except (OSError, ValueError, AttributeError, RecursionError):
                continue
            if case != patient.name:
                odd.append(f"{file} names case {str(case)[:64]!r}, and is taken for a plan of {patient.name!r}.")
    return odd


def _of_folder(folder: Path) -> NewPatient:
    name = folder.resolve().name
    check_name(name, name, folder)
    images = [path for path in sorted(folder.iterdir()) if path.name.split(".")[0] == "segmentation"]
    if len(images) != 1:
        listed = ", ".join(path.name for path in images) or "no segmentation"
        raise InputError(
            name, folder, f"it holds {listed}", "keep one: segmentation.nii.gz, .nrrd, .mha, .dcm, or a folder"
        )
    plans = {}
    second = [path.name for path in sorted(folder.iterdir()) if path.stem.startswith("plan.") or path.stem == "plan"]
    for entry in dict.fromkeys(
        ["plan.json", "plan", "plans", *(name for name in second if _is_segmentation(Path(name)))]
    ):
        if (folder / entry).exists():
            own = _plans(name, folder / entry)
            if twice := sorted(own.keys() & plans.keys()):
                raise InputError(name, folder, f"plan {twice[0]!r} is there twice", "give each plan a name of its own")
            plans |= own
    volumes = [path for path in sorted(folder.iterdir()) if path.name.split(".")[0] in VOLUMES]
    if len(volumes) > 1:
        listed = ", ".join(path.name for path in volumes)
        raise InputError(name, folder, f"it holds {listed}", "keep one scan: the one that was segmented")
    return NewPatient(
        name=name,
        segmentation=str(images[0]),
        plans=plans,
        home=str(folder),
        volume=str(volumes[0]) if volumes else "",
        markups=str(folder) if markups_in(folder) else "",
        wishes=tuple(str(path) for path in sorted(folder.iterdir()) if _is_wish(path)),
        covariates=_covariates(name, folder / COVARIATES_FILE),
    )


def _covariates(case: str, path: Path) -> dict[str, str | float | bool]:
    """What the file says, in the words of a cohort table; nothing without the file."""
    if not path.exists():
        return {}

    def refuse(problem: str, remedy: str):
        raise InputError(case, path, problem, remedy)

    told = read_json(path, refuse)
    if not isinstance(told, dict) or (unknown := [name for name in told if name not in COVARIATES]):
        refuse("it holds " + (repr(unknown[0]) if isinstance(told, dict) else "no object"), f"keep {[*COVARIATES]}")
    said = {name: "" if value is None else WORDS.get(str(value), str(value)) for name, value in told.items()}
    return covariates_of(said, case, path)


def _plans(case: str, path: str | os.PathLike) -> dict[str, str]:
    """Plans by name: of a file, of a folder of transforms, or of a folder with several of either."""
    path = Path(path)
    own = [path]
    if path.is_dir():
        several = [
            own for own in sorted(path.iterdir()) if own.suffix == ".json" or own.is_dir() or _is_segmentation(own)
        ]
        own = several if path.name == "plans" else several or own
    plans = {}
    for plan in own:
        name = plan.name.split(".")[0] if _is_segmentation(plan) else plan.stem
        check_name(case, name, plan)
        if name.lower() in map(str.lower, plans):
            raise InputError(case, plan, f"plan {name!r} is there twice", "give each plan a name of its own")
        plans[name] = str(plan)
    return plans


def _is_segmentation(path: Path) -> bool:
    """Whether a plan is a second segmentation, after surgery, which shows the motion that was achieved."""
    return path.name.lower().endswith(IMAGE_FORMATS)


def _is_wish(path: Path) -> bool:
    """Whether a file says how the face shall be: wish.mrk.json, wish.ply, or several as wish_chin.mrk.json."""
    name = path.name.lower()
    return name.split(".")[0].split("_")[0] == WISH and name.endswith(WISHES)
