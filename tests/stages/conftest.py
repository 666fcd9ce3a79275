"""One coarse virtual patient, carried through the stages once per test session."""

import shutil
from dataclasses import dataclass
from pathlib import Path

import pytest
import torch

from pinnochio.mechanics.settings import FemSettings
from pinnochio.model.measures import MEASURES
from pinnochio.model.regions import NAMES
from pinnochio.patients.model_archive import Archive, calibration_file, network_file
from pinnochio.statistics.intervals import Calibration
from pinnochio.virtual.head import USUAL
from scripts.cohort.carry_truth import carry_truth
from scripts.cohort.virtual_outcome import virtual_outcome
from scripts.cohort.virtual_patient import draw_covariates
from scripts.fem.simulate_fem import simulate_fem
from scripts.patient.choose_samples import choose_samples
from scripts.patient.make_lift import write_lift
from scripts.patient.register_postop import register_postop
from scripts.patient.report_quality import report_quality
from scripts.patients.describe_training import describe_training
from studies.planner.prepare_planner import prepare_planner
from studies.planner.prepared import Prepared
from tests.helpers.coarse_head import modelled
from tests.helpers.settings import CONFIG, OUTCOME, SEED, SEGMENTS, network_settings
from tests.helpers.training import learn_loads, save_random


@dataclass(frozen=True)
class Patient:
    """A case name, the folder of its files and the settings they were made with."""

    case: str
    folder: Path
    fem: FemSettings

    def __getattr__(self, name: str) -> str:
        """Path of a file by its stem, e.g. `patient.model`."""
        matches = [path for path in self.folder.iterdir() if path.name.split(".")[0] == name]
        if not matches:
            raise AttributeError(name)
        return str(matches[0])


def make_patient(case: str, number: int, folder: Path, procedure=USUAL) -> Patient:
    """A 2 mm head on 700 nodes, operated so, with its outcome, registered scan and two fem_samples plans."""

    def file(name: str) -> str:
        return str(folder / name)

    fem = FemSettings(**CONFIG["fem"])
    files = modelled(case, number, folder, procedure, 700)
    sources = {name: files[name] for name in ("segmentation", "plan", "landmarks", "anatomy")}
    covariates, plan, model = file("covariates.json"), files["imported_plan"], files["model"]
    draw_covariates(case, sources["anatomy"], OUTCOME["reality"], SEED, covariates)
    made = {"postop": file("scan.ply"), "truth": file("truth.h5"), "executed": file("executed.json")}
    covered = sources | {"covariates": covariates}
    virtual_outcome(case, covered, OUTCOME, CONFIG["labels"], tuple(CONFIG["segments"]), SEED, **made)
    register_postop(case, made["postop"], files["skin"], files["bone"], 20.0, 1.5, file("postop.h5"))
    choose_samples(case, model, plan, file("postop.h5"), 3000, SEED, file("judged.h5"))
    carry_truth(case, file("truth.h5"), model, file("true_motion.h5"))
    simulate_fem(case, model, plan, 2, fem, SEED, file("fem_samples.h5"))
    return Patient(case, folder, fem)


@pytest.fixture(scope="session")
def patients(tmp_path_factory) -> list[Patient]:
    """Two patients: a Class II and a Class III."""
    return [make_patient(f"T{n}", n, tmp_path_factory.mktemp(f"T{n}")) for n in (0, 1)]


@pytest.fixture(scope="session")
def patient(patients) -> Patient:
    return patients[0]


METHOD = "pinnochio_plus"
SMALL = network_settings(
    **(CONFIG["network"] | {"lift": "elastic", "volume_layers": 0, "boundary_layers": 1, "channels": 8})
)


@pytest.fixture(scope="session")
def training(patients, tmp_path_factory) -> tuple[str, list[str]]:
    """Ranges of the patients as training, and their quality reports."""
    folder = tmp_path_factory.mktemp("training")
    reports = [str(folder / f"{patient.case}.json") for patient in patients]
    for patient, report in zip(patients, reports, strict=True):
        report_quality(patient.model, patient.report, report)
    columns = ([getattr(patient, name) for patient in patients] for name in ("case", "model", "plan"))
    describe_training(*columns, reports, str(folder / "ranges.json"))
    return str(folder / "ranges.json"), reports


@pytest.fixture(scope="session")
def prepared(patients, training, tmp_path_factory):
    """The first of two patients, prepared for the planner with an archive of two networks that nobody has trained."""
    patient, folder = patients[0], tmp_path_factory.mktemp("planner")
    archive = folder / "archive"
    archive.mkdir()
    shutil.copy(training[0], archive)
    methods = {METHOD: {"corrections": 1, "lift": "elastic", "usual": {}}}
    Archive("virtual cohort", 2, SEGMENTS, ["1", "2"], methods, {}, "abc", "def").write(archive)
    widths = dict.fromkeys(NAMES, 1.5), dict.fromkeys(NAMES, 0.01), dict.fromkeys(MEASURES, 2.0)
    Calibration(METHOD, 0.9, 2, 2, *widths).write(archive / calibration_file(METHOD))
    learned = learn_loads(patients, str(folder / "fitted.h5"))
    sources = {name: torch.as_tensor(value) for name, value in learned.state().items()}
    for number, fold in enumerate("12"):
        save_random(archive / network_file(METHOD, fold), SMALL, number, sources=sources)
    lift = str(folder / "lift.h5")
    write_lift(patient.model, 16, patient.fem, lift)
    (folder / "set").mkdir()
    (folder / "set/plan.json").write_text(Path(patient.plan).read_text())
    settings = {"home": str(folder), "archive": str(archive), "method": METHOD, "corrections": 1}
    settings |= {
        "fem": vars(patient.fem),
        "invert": CONFIG["invert"],
        "scan": {"nasion_above_maxilla": 20.0, "limit": 1.5},
    }
    out = str(folder / "planner.json")
    files = {name: getattr(patient, name) for name in ("model", "skin", "bone")}
    files |= {"lift": lift, "quality": training[1][0]}
    prepare_planner(patient.case, files, [str(folder / "set/plan.json")], settings, out)
    return Prepared.read(out)
