"""Makes the certificate of a new patient's prediction."""

from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path

from pinnochio.json_text import read_stored_json, write_json
from pinnochio.mechanics.settings import FemSettings
from pinnochio.methods.elastic import linear_field
from pinnochio.metrics.worst_point import apart
from pinnochio.model.patient import PatientModel
from pinnochio.patients.certificate import RESEARCH, interval_measures, measures, of_import, plain, verdict
from pinnochio.patients.in_distribution import widening
from pinnochio.patients.model_archive import Archive, calibration_file
from pinnochio.patients.result import read_patient, read_result, read_solution
from pinnochio.plans.plan import Plan
from pinnochio.statistics.intervals import Calibration


def certify(
    about: Mapping,
    model: str,
    plan: str,
    quality: str,
    result: str,
    fem: FemSettings,
    folder: str | None,
    compared: Mapping | None,
    certificate: str,
) -> None:
    """Write the certificate as JSON.

    about: case, plan (its name), method, corrections, code; whose place it takes (`instead_of`) and why (`because`).
    folder: the archive of a learned method, else None; compared: how patient and plan lie to its training.
    """
    patient, planned = read_patient(model), Plan.read(plan, about["case"])
    prediction = read_result(result, about["case"], patient)
    content = {
        "research": RESEARCH,
        **about,
        "frame": "LPS",
        "units": "mm",
        "models": None,
        "solution": asdict(read_solution(result, about["case"])),
        "measures": measures(patient, planned, prediction.displacement, fem, prediction.forces)
        | {"apart_mm": from_elasticity(patient, planned, prediction.displacement, fem)},
        "interval": None,
        "in_distribution": compared,
        "import": of_import(read_stored_json(quality), planned.warnings),
    }
    if folder:
        archive, calibration = Archive.read(folder), Calibration.read(Path(folder) / calibration_file(about["method"]))
        content["models"] = {key: getattr(archive, key) for key in ("cohort", "patients", "configuration", "code")}
        content["models"] |= {
            "folds": len(archive.folds),
            "usual": archive.methods.get(about["method"], {"usual": {}})["usual"],
        }
        content["interval"] = interval_measures(prediction, calibration, widening(compared))
    content = plain(content)
    content["verdict"] = verdict(content)._asdict()
    write_json(certificate, content)


def from_elasticity(patient: PatientModel, plan: Plan, displacement, fem: FemSettings) -> float:
    """How far (mm) a point of the judged skin at most is from where linear elasticity takes it: what predicts every
    patient at once."""
    fields = displacement, linear_field(patient, plan, fem, warm=False)[0]
    one, other = (patient.moved_skin(field)[patient.judged_points] for field in fields)
    return apart(one, [other])
