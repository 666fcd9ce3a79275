"""Patients of a study and new ones: a segmentation, one or several plans, and what else is known of each."""

import json
import os
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from textwrap import shorten

from pinnochio.errors import InputError, printable, refusal
from pinnochio.files import check_brought, check_name, entries
from pinnochio.importing.cohort import COVARIATES, Case, covariates_of, read_cases
from pinnochio.json_text import read_json
from pinnochio.plans.plan import TRANSFORM_FORMATS
from pinnochio.study.choice import Choice
from pinnochio.volume_size import IMAGE_FORMATS

VOLUMES = ("volume", "ct", "cbct", "dicom")  # names of the scan, before its ending
ENDING = ".mrk.json"
COVARIATES_FILE = "covariates.json"
WORDS = {"True": "yes", "False": "no"}  # of a cohort table for JSON's own
WISH = "wish"  # name of what is wished of the face, before its ending
SURFACES = (".ply", ".stl", ".vtp", ".obj")
WISHES = (ENDING, ".fcsv", *SURFACES, ".csv", ".tsv")
BESIDE_SCAN = (".raw", ".raw.gz", ".zraw", ".json", ".txt")  # endings of what lies beside a scan: voxels, what it is
SCANS = tuple(f"postop{ending}" for ending in SURFACES)  # what the planner reads beside the patient
OTHERS = ("transforms", "readme")  # what it writes there, and what people do, before its ending


@dataclass(frozen=True, kw_only=True)
class Patient(Case):
    """A patient of a study or a new one: the case that the user, or the virtual cohort, brings, and where its files go.

    folder: of its files, below the results; plans: files or folders by the plan's name, which is empty for the one plan
    of a patient of a study; source: the folder that what is planned for a new patient is saved in; checked: the table
    that says that all of it has been read and checked; wishes: files that say how the face shall be; unused: names of
    files of the folder that nothing reads. config: the configuration that the patient's files are made with; choice:
    what predicts it, where that is chosen: of a new one.
    """

    folder: str
    plans: Mapping[str, str]
    checked: str
    source: str = ""
    wishes: Sequence[str] = ()
    unused: Sequence[str] = ()
    config: Mapping = field(default_factory=dict)
    choice: Choice | None = None


def of_study(case: Case, config: Mapping) -> Patient:
    """The patient of a cohort."""
    folder, plans = f"<results>/cases/{case.name}", {"": case.plan}
    return Patient(**vars(case), folder=folder, plans=plans, checked="<results>/cohort.csv", config=config)


def markups_in(folder: str | os.PathLike) -> list[str]:
    """The files of markups of the patient as it is; what is wished is none of them."""
    files = [path for path in entries(folder) if path.name.lower().endswith((ENDING, ".fcsv"))]
    return [str(path) for path in files if not _is_wish(path)]


def _stem(path: Path) -> str:
    """The name before its endings; letters of either case are the same."""
    return path.name.split(".")[0].lower()


def _is_image(path: Path) -> bool:
    return path.name.lower().endswith(IMAGE_FORMATS)


def read_patients(path: str | os.PathLike) -> dict[str, Patient]:
    """The new patients by name: the one of a folder, or those of a table with the columns of a cohort table.

    A folder bears the patient's name and holds `segmentation.*` (or the folder `segmentation` of surfaces or of several
    images) and, unless there is no plan yet, `plan.json`, the folder `plan` of transforms, or `plans/` with several of
    either; a plan may be a second segmentation, after surgery. The scan is one of VOLUMES; markups (`.mrk.json`) and
    `covariates.json` lie beside it, and so does what is wished of the face, `wish.*`. In a table the plan may be such a
    folder of plans too; it has no wishes. InputError for what is missing or there twice.
    """
    path = Path(path)
    if os.path.exists(path):  # not of a path that is too long
        check_brought("-", path)
    if os.path.isdir(path):
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
            if not case.left_out
        ]
    else:
        raise InputError("-", path, "there is no such folder or table", "name the patient's folder: patient=FOLDER")
    return {patient.name: patient for patient in patients}


def oddities(patients: Iterable[Patient]) -> list[str]:
    """What is odd of new patients: files that nothing reads, and plans that name another case than the patient that
    they lie with; what cannot be read is skipped, because importing it says why."""
    odd = []
    for patient in patients:
        if patient.unused:
            listed = shorten(", ".join(patient.unused), 300, placeholder=" ...")
            odd.append(printable(f"{patient.source}: nothing reads {listed}."))
        for file in patient.plans.values():
            try:
                case = json.loads(Path(file).read_bytes().decode("utf-8-sig")).get("case", patient.name)
            except (OSError, ValueError, AttributeError, RecursionError):
                continue
            if case != patient.name:
                odd.append(
                    f"{file} names case {str(case)[:64]!r}, and is taken for a plan of {patient.name!r}. Is it the "
                    "right patient's?"
                )
    return odd


def _new(name: str, **files) -> Patient:
    folder = f"<results>/patients/{name}"
    return Patient(name=name, folder=folder, checked=f"{folder}/imported.csv", **files)


def _of_folder(folder: Path) -> Patient:
    name = folder.resolve().name
    check_name(name, name, folder)
    files = entries(folder)
    images = [path for path in files if _stem(path) == "segmentation" and (_is_image(path) or path.is_dir())]
    if len(images) != 1:
        likely = images or [path for path in files if path.name.lower().startswith("seg")]
        listed = ", ".join(path.name for path in likely) or "no segmentation"
        remedy = "keep one: segmentation.nii.gz, .nrrd, .mha, .dcm, or a folder segmentation/ (of surfaces: skull.stl)"
        raise InputError(name, folder, f"it holds {listed}", remedy)
    for path in files:
        text = path.suffix.lower() == ".json" and not path.name.lower().endswith(ENDING)
        if text and path.is_file() and b'"markups"' in path.read_bytes():
            raise InputError(name, path, "it holds points, and is not read", f"save them as markups ({ENDING})")
    second = [path for path in files if _stem(path) == "plan" and _is_image(path)]
    listed = [path for path in files if path.name.lower() in ("plan.json", "plan", "plans")]
    plans = {}
    for path in [*listed, *second]:
        further = _plans(name, path)
        if twice := sorted(further.keys() & plans.keys()):
            raise InputError(name, folder, f"plan {twice[0]!r} is there twice", "give each plan a name of its own")
        plans |= further
    volumes = [path for path in files if _stem(path) in VOLUMES and not _beside(path)]
    if len(volumes) > 1:
        shown = ", ".join(path.name for path in volumes)
        raise InputError(name, folder, f"it holds {shown}", "keep one scan: the one that was segmented")
    wishes = [path for path in files if _is_wish(path)]
    known = next((path for path in files if path.name.lower() == COVARIATES_FILE), folder / COVARIATES_FILE)
    read = {*images, *volumes, *listed, *second, *wishes, *map(Path, markups_in(folder)), known}
    for path in sorted(read):
        check_brought(name, path)
    return _new(
        name,
        segmentation=str(images[0]),
        plans=plans,
        source=str(folder),
        volume=str(volumes[0]) if volumes else "",
        markups=str(folder) if markups_in(folder) else "",
        wishes=tuple(map(str, wishes)),
        unused=tuple(
            path.name
            for path in files
            if path not in read and path.name.lower() not in SCANS and _stem(path) not in OTHERS and not _beside(path)
        ),
        covariates=_covariates(name, known),
    )


def _beside(path: Path) -> bool:
    """Whether a file lies beside a scan or its labels: their voxels, what is known of them."""
    return _stem(path) in (*VOLUMES, "segmentation") and path.name.lower().endswith(BESIDE_SCAN)


def _covariates(case: str, path: Path) -> dict[str, str | float | bool]:
    """What the file says, in the words of a cohort table; nothing without the file."""
    if not path.exists():
        return {}
    refuse = refusal(case, path)
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
        inside = entries(path)
        if marked := [file for file in inside if file.name.lower().endswith(ENDING)]:
            raise InputError(case, marked[0], "markups are no plan", "put them beside the segmentation")
        several = [file for file in inside if file.suffix.lower() == ".json" or file.is_dir() or _is_image(file)]
        # Transforms, or arches, that lie there by themselves are one plan.
        endings = {file.suffix.lower() for file in inside} - {".txt"}
        bare = not endings.isdisjoint((*TRANSFORM_FORMATS, *SURFACES))
        files = several + [path] * (bare or not several and path.name.lower() != "plans")
    plans = {}
    for plan in files:
        name = plan.name.split(".")[0] if _is_image(plan) else plan.stem
        if plan == path and plan.name.lower() == "plans":
            name = "plan"
        check_name(case, name, plan)
        check_brought(case, plan)
        if name.lower() in map(str.lower, plans):
            raise InputError(case, plan, f"plan {name!r} is there twice", "give each plan a name of its own")
        plans[name] = str(plan)
    return plans


def _is_wish(path: Path) -> bool:
    """Whether a file says how the face shall be: wish.mrk.json, wish.ply, or several as wish_chin.mrk.json."""
    name = path.name.lower()
    return re.split(r"[._-]", name)[0] == WISH and name.endswith(WISHES)
