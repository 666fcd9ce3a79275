"""One coarse virtual patient, carried through the stages once per test session."""

import json
from dataclasses import dataclass
from pathlib import Path

import pytest
import torch

from pinnochio.mechanics.settings import FemSettings
from pinnochio.metrics.model_quality import quality
from pinnochio.model.patient import PatientModel
from pinnochio.model.regions import NAMES
from pinnochio.networks.building import build
from pinnochio.patients.model_archive import Archive, calibration_file, network_file
from pinnochio.statistics.intervals import Calibration
from pinnochio.training.checkpoint import save_network
from pinnochio.virtual.head import USUAL
from scripts.cohort.carry_truth import carry_truth
from scripts.cohort.sample_covariates import draw_covariates
from scripts.cohort.virtual_outcome import virtual_outcome
from scripts.fem.simulate_fem import simulate_fem
from scripts.patient.choose_samples import choose_samples
from scripts.patient.make_lift import write_lift
from scripts.patient.register_postop import register_postop
from scripts.patients.describe_training import describe_training
from studies.planner.prepare_planner import prepare_planner
from studies.planner.prepared import Prepared
from tests.helpers.coarse_head import modelled
from tests.helpers.settings import CONFIG, OUTCOME, SEED, SEGMENTS, network_settings
from tests.helpers.training import learn_loads


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
    virtual_outcome(case, covered, OUTCOME, CONFIG["labels"], tuple(CONFIG["segments"]), SEED, made)
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
def prepared(patients, tmp_path_factory):
    """The first of two patients, prepared for the planner with an archive of two networks that nobody has trained."""
    patient, folder = patients[0], tmp_path_factory.mktemp("planner")
    reports = []
    for other in patients:
        reports.append(str(folder / f"{other.case}.json"))
        report = quality(PatientModel.read(other.model), json.loads(Path(other.report).read_text()))
        Path(reports[-1]).write_text(json.dumps(report))
    columns = ([getattr(other, name) for other in patients] for name in ("case", "model", "plan"))
    archive = folder / "archive"
    archive.mkdir()
    describe_training(*columns, reports, str(archive / "ranges.json"))
    methods = {METHOD: {"corrections": 1, "lift": "elastic", "usual": {}}}
    Archive("virtual cohort", 2, SEGMENTS, ["1", "2"], methods, {}, "abc", "def").write(archive)
    widths = dict.fromkeys(NAMES, 1.5), dict.fromkeys(NAMES, 0.01)
    Calibration(METHOD, 0.9, 2, 2, *widths).write(archive / calibration_file(METHOD))
    learned = learn_loads(patients, str(folder / "fitted.h5"))
    sources = {name: torch.as_tensor(value) for name, value in learned.state().items()}
    for number, fold in enumerate("12"):
        torch.manual_seed(number)
        network = build(SMALL)
        with torch.no_grad():
            for weights in network.parameters():  # as built, every network gives out what the lift says
                weights += 0.02 * torch.randn_like(weights)
        save_network(archive / network_file(METHOD, fold), network, SMALL, sources=sources)
    lift = str(folder / "lift.h5")
    write_lift(patient.model, "elastic", 16, patient.fem, lift)
    (folder / "set").mkdir()
    (folder / "set/plan.json").write_text(Path(patient.plan).read_text())
    settings = {"home": str(folder), "archive": str(archive), "method": METHOD, "corrections": 1}
    settings |= {"fem": vars(patient.fem), "invert": CONFIG["invert"]}
    out = str(folder / "planner.json")
    files = patient.model, lift, patient.covariates, reports[0]
    prepare_planner(patient.case, *files, [str(folder / "set/plan.json")], settings, out)
    return Prepared.read(out)
