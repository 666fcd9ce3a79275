"""Patients of a study and new ones: a segmentation, one or several plans, and what else is known of each."""

import json
import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from pinnochio.errors import InputError
from pinnochio.files import check_name
from pinnochio.importing.cohort import COVARIATES, Case, covariates_of, read_cases
from pinnochio.json_text import read_json
from pinnochio.study.choice import Choice
from pinnochio.volume_size import IMAGE_FORMATS

VOLUMES = ("volume", "ct", "cbct")  # names of the scan, before its ending
ENDING = ".mrk.json"
COVARIATES_FILE = "covariates.json"
WORDS = {"True": "yes", "False": "no"}  # of a cohort table for JSON's own
WISH = "wish"  # name of what is wished of the face, before its ending
WISHES = (ENDING, ".ply", ".stl", ".vtp", ".obj", ".csv", ".tsv")


@dataclass(frozen=True)
class Patient:
    """A patient of a study or a new one: what the user, or the virtual cohort, brings, and where its files go.

    folder: of its files, below the results; segmentation: a file or a folder of surfaces; plans: files or folders by
    the plan's name, which is empty for the one plan of a patient of a study; source: the folder that what is planned
    for a new patient is saved in; checked: the table that says that all of it has been read and checked.
    volume: the scan; markups: a file or folder of them; postop, postop_bones: skin and bones after surgery; all empty
    where there is none; postop_frame: "bones" where both are of one scan. covariates: what else is known, by name;
    covariates_file: JSON that holds it instead; wishes: files that say how the face shall be. config: the configuration
    that the patient's files are made with; choice: what predicts it, where that is chosen: of a new one.
    """

    name: str
    folder: str
    segmentation: str
    plans: Mapping[str, str]
    checked: str
    source: str = ""
    volume: str = ""
    markups: str = ""
    postop: str = ""
    postop_bones: str = ""
    postop_frame: str = ""
    covariates: Mapping[str, str | float | bool] = field(default_factory=dict)
    covariates_file: str = ""
    wishes: Sequence[str] = ()
    config: Mapping = field(default_factory=dict)
    choice: Choice | None = None


def of_study(case: Case, config: Mapping) -> Patient:
    """The patient of a cohort."""
    return Patient(
        folder=f"<results>/cases/{case.name}",
        plans={"": case.plan},
        checked="<results>/cohort.csv",
        config=config,
        **{key: value for key, value in vars(case).items() if key != "plan"},
    )


def markups_in(folder: str | os.PathLike) -> list[str]:
    """The files of markups of the patient as it is; what is wished is none of them."""
    files = [path for path in sorted(Path(folder).iterdir()) if path.name.endswith(ENDING)]
    return [str(path) for path in files if not _is_wish(path)]


def read_patients(path: str | os.PathLike) -> dict[str, Patient]:
    """The new patients by name: the one of a folder, or those of a table with the columns of a cohort table.

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
            _new(
                case.name,
                segmentation=case.segmentation,
                plans=_plans(case.name, case.plan),
                source=str(path.parent / case.name),
                volume=case.volume,
                markups=case.markups,
                covariates=case.covariates,
            )
            for case in read_cases(path)
        ]
    else:
        raise InputError("-", path, "there is no such folder or table", "name the patient's folder: patient=FOLDER")
    return {patient.name: patient for patient in patients}


def other_cases(patients: Iterable[Patient]) -> list[str]:
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


def _new(name: str, **files) -> Patient:
    folder = f"<results>/patients/{name}"
    return Patient(name, folder, checked=f"{folder}/imported.csv", **files)


def _of_folder(folder: Path) -> Patient:
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
            further = _plans(name, folder / entry)
            if twice := sorted(further.keys() & plans.keys()):
                raise InputError(name, folder, f"plan {twice[0]!r} is there twice", "give each plan a name of its own")
            plans |= further
    volumes = [path for path in sorted(folder.iterdir()) if path.name.split(".")[0] in VOLUMES]
    if len(volumes) > 1:
        listed = ", ".join(path.name for path in volumes)
        raise InputError(name, folder, f"it holds {listed}", "keep one scan: the one that was segmented")
    return _new(
        name,
        segmentation=str(images[0]),
        plans=plans,
        source=str(folder),
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

    content = read_json(path, refuse)
    if not isinstance(content, dict) or (unknown := [name for name in content if name not in COVARIATES]):
        problem = repr(unknown[0]) if isinstance(content, dict) else "no object"
        refuse(f"it holds {problem}", f"keep {[*COVARIATES]}")
    words = {name: "" if value is None else WORDS.get(str(value), str(value)) for name, value in content.items()}
    return covariates_of(words, case, path)


def _plans(case: str, path: str | os.PathLike) -> dict[str, str]:
    """Plans by name: of a file, of a folder of transforms, or of a folder with several of either."""
    path = Path(path)
    files = [path]
    if path.is_dir():
        several = [
            file for file in sorted(path.iterdir()) if file.suffix == ".json" or file.is_dir() or _is_segmentation(file)
        ]
        files = several if path.name == "plans" else several or files
    plans = {}
    for plan in files:
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
