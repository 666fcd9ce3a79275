"""One coarse virtual patient, carried through the stages once per test session."""

from dataclasses import dataclass
from pathlib import Path

import pytest

from pinnochio.mechanics.settings import FemSettings
from pinnochio.virtual.head import USUAL
from scripts.choose_samples import choose_samples
from scripts.import_plan import import_plan
from scripts.import_segmentation import import_segmentation
from scripts.label_interfaces import label_case
from scripts.register_postop import register_postop
from scripts.sample_covariates import draw_covariates
from scripts.simulate_fem import simulate_fem
from scripts.tetrahedralize import mesh_case
from scripts.virtual_outcome import virtual_outcome
from scripts.virtual_patient import virtual_patient
from tests.helpers.settings import CONFIG, OUTCOME, SEED


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
    sources = {
        "segmentation": file("segmentation.nii.gz"),
        "plan": file("input_plan.json"),
        "landmarks": file("landmarks.json"),
        "anatomy": file("anatomy.json"),
    }
    anatomy, muscles = CONFIG["virtual"]["anatomy"], CONFIG["virtual"]["muscles"]
    virtual_patient(case, number, SEED, anatomy, 2.0, CONFIG["labels"], procedure, muscles, sources)
    covariates = file("covariates.json")
    draw_covariates(case, sources["anatomy"], OUTCOME["reality"], SEED, covariates)
    made = {"postop": file("scan.ply"), "truth": file("truth.h5"), "executed": file("executed.json")}
    vocabulary = tuple(CONFIG["segments"])
    virtual_outcome(case, sources | {"covariates": covariates}, OUTCOME, CONFIG["labels"], vocabulary, SEED, made)
    names = {"labels": "labels.nii.gz", "bone": "bone.vtp", "skin": "skin.vtp", "report": "report.json"}
    imported = {key: file(name) for key, name in names.items()}
    import_segmentation(
        case, sources["segmentation"], CONFIG["labels"], vocabulary, "header", 2.0, "derived", 6.0, imported
    )  # fmt: skip
    plan = file("plan.json")
    import_plan(case, sources["plan"], imported["bone"], plan)
    mesh_case(imported["labels"], 700, 12.0, file("mesh.vtu"))
    label_case(
        file("mesh.vtu"),
        imported["labels"],
        imported["bone"],
        imported["skin"],
        imported["report"],
        CONFIG["interfaces"],
        file("model.h5"),
    )
    register_postop(case, made["postop"], imported["skin"], imported["bone"], 20.0, 1.5, file("postop.h5"))
    choose_samples(case, file("model.h5"), plan, file("postop.h5"), 3000, SEED, file("judged.h5"))
    simulate_fem(case, file("model.h5"), plan, 2, fem, SEED, file("fem_samples.h5"))
    return Patient(case, folder, fem)


@pytest.fixture(scope="session")
def patients(tmp_path_factory) -> list[Patient]:
    """Two patients: a Class II and a Class III."""
    return [make_patient(f"T{n}", n, tmp_path_factory.mktemp(f"T{n}")) for n in (0, 1)]


@pytest.fixture(scope="session")
def patient(patients) -> Patient:
    return patients[0]
