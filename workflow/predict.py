"""Predicts new patients in one process: what `snakemake predict` makes, sooner. Keys are those of the configuration.

python workflow/predict.py patient=FOLDER [models=ARCHIVE] [predict='{method: fem_sliding}'] [--configfile FILE]
"""

import argparse
import os
import sys
from collections.abc import Mapping, Sequence
from functools import partial, reduce
from importlib import import_module
from pathlib import Path
from threading import Thread
from types import SimpleNamespace

# As in the workflow: no library takes more cores than there are processes.
for variable in ("IGL_NUM_THREADS", "ITK_GLOBAL_DEFAULT_NUMBER_OF_THREADS", "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ.setdefault(variable, "1")
sys.path.append(str(Path(__file__).resolve().parents[1]))

import yaml  # noqa: E402

from pinnochio.beside import beside  # noqa: E402
from pinnochio.code import ROOT  # noqa: E402
from pinnochio.errors import InputError, StorageError  # noqa: E402
from pinnochio.files import alone  # noqa: E402
from pinnochio.logs import attach_log, warnings_in  # noqa: E402
from pinnochio.mechanics.settings import FemSettings  # noqa: E402
from pinnochio.overlays import overlaid  # noqa: E402
from pinnochio.references import resolve  # noqa: E402
from pinnochio.stages import Stages  # noqa: E402
from pinnochio.study.configuration import check_config  # noqa: E402
from pinnochio.study.inputs.rules import RuleInputs  # noqa: E402
from pinnochio.study.patients import Patient, oddities  # noqa: E402
from pinnochio.study.schema import checked, read_schema, refuse_doubled  # noqa: E402
from pinnochio.study.study import Study  # noqa: E402
from scripts.patient.import_case import SURFACES, import_case, settings_of  # noqa: E402
from scripts.patient.model_patient import model_patient  # noqa: E402

IMPORTED = {"labels": "labels.nii.gz", "bone": "bone.vtp", "skin": "skin.vtp", "report": "import.json"}
MODELLED = {"mesh": "mesh.vtu", "model": "model.h5", "quality": "quality.json"}
PATHS = ("patient", "models")  # which a shell passes as they are: a folder may be called 007
# Imported when they are run: the process beside this one begins sooner.
PLAN, CHECK = "scripts.patients.predict_plan:predict_plan", "scripts.patient.check_cohort:check_cohort"
SEGMENTS, QUALITY = "scripts.patient.show_segments:show_segments", "scripts.patient.show_quality:show_quality"
PREDICTED = {"certificate": "certificate.json", "page": "index.html", "measures": "measures.csv"}
PREDICTED |= {"mesh": "deformed.vtu", "bones": "bones"}


def predict_new(config: Mapping) -> None:
    """Predict all plans of the new patients that a configuration names, say where their pages are, draw the rest."""
    study = Study.of(config)
    inputs = RuleInputs(study)
    inputs.patients.predictions(None)  # refuses a patient without a plan
    print(*filter(None, [study.choice.in_words, *oddities(study.new_patients.values())]), sep="\n", flush=True)
    for name in study.new_patients:
        patient = study.new_patient(name)
        folder = patient.folder.replace("<results>", study.results)
        with alone(name, folder):
            attach_log(log := f"{study.results}/logs/predict/{name}.log")
            pages, model, imported = predict_patient(patient, folder, inputs)
            warned = [f"Warning: {words}" for words in warnings_in(log)]
            print(*warned, f"{name} is predicted; open {' '.join(pages)}", sep="\n", flush=True)
            begin = partial(beside().submit, Stages(f"{folder}/.pictures.json"))
            shown = {key: imported[key] for key in ("bone", "skin", "report")}
            begun = [begin(SEGMENTS, shown, {"picture": f"{folder}/segments.png"}, {})]
            begun.append(begin(QUALITY, {"model": model}, {"picture": f"{folder}/quality.png"}, {"case": name}))
            for each in begun:
                each.result()


def predict_patient(patient: Patient, folder: str, inputs: RuleInputs) -> tuple[list[str], str, dict[str, str]]:
    """Run all stages of a patient, whose files go into the folder, and of its plans as the rules do; pages, model and
    imported files. What was made of the same, by the rules too, is kept."""
    job = SimpleNamespace(home="patients", case=patient.name, plan="", method=patient.choice.method)
    config, predictor, ensemble = patient.config, inputs.prediction.predictor(job), inputs.prediction.ensemble(job)
    outs = {plan: f"{folder}/{plan}/{job.method}" for plan in patient.plans}
    pages = [f"{out}/{PREDICTED['page']}" for out in outs.values()]
    fem, files = FemSettings(**config["fem"]), {name: f"{folder}/{file}" for name, file in MODELLED.items()}
    imported = {name: f"{folder}/{file}" for name, file in IMPORTED.items()}
    bringing = partial(bring, patient, folder, inputs.patient.markups(job), inputs.patient.covariates(job), imported)
    modelling = partial(
        model_patient,
        case=job.case,
        imported=imported,
        mesh_settings={name: config["mesh"][name] for name in ("nodes", "minimum_dihedral")},
        interfaces=config["interfaces"],
        controls=config["lift"]["controls"],
        fem=fem,
    )
    bringing(("covariates", "labels"))
    others = beside().submit(bringing, ("surfaces", "plan"))
    if not all(map(os.path.isfile, pages)):
        for module in ("scripts.patients.show_prediction", "pyvista.plotting"):
            beside().submit(import_module, module)
        if ensemble.networks:
            Thread(target=import_module, args=["torch"]).start()  # a second beside the mesh
    modelling(outputs={"mesh": files["mesh"]})
    resolve(PLAN)  # imported while the process beside this one is at work
    others.result()
    table = {"table": f"{folder}/imported.csv"}
    Stages(f"{folder}/.check.json")(CHECK, {"reports": [imported["report"]]}, table, {"cases": [job.case]})
    modelling(outputs=files | ({"lift": f"{folder}/lift_elastic.h5"} if inputs.patient.lift else {}))
    made, corrections = {}, patient.choice.corrections
    for plan, out in outs.items():
        made[plan] = {name: f"{out}/{Path(file).name}" for name, file in (inputs.patients.fields | PREDICTED).items()}
        made[plan] |= {"skin": [f"{out}/skin.{kind}" for kind in ("vtp", "ply", "stl")]}
        planned = {"model": files["model"], "plan": f"{folder}/{plan}/plan.json"}
        resolve(PLAN)(
            about=vars(job) | {"plan": plan, "code": inputs.patients.predicts, "corrections": corrections},
            planned=planned,
            quality=files["quality"],
            fem=fem,
            method={"predictor": predictor, "settings": ensemble.settings, "device": "cpu", "threads": 1},
            networks=dict(zip(ensemble.folds, ensemble.networks, strict=True)),
            lifts=[f"{folder}/{Path(path).name}" for path in ensemble.lifts],
            covariates=[f"{folder}/{Path(path).name}" for path in ensemble.covariates],
            archive=patient.choice.folder,
            others=inputs.prediction.others(job),
            seconds=patient.choice.seconds,
            outputs=made[plan],
        )
        made[plan]["plan"] = planned["plan"]
    if len(pages) > 1:
        pages.append(f"{folder}/plans_{job.method}.html")
        keys = {"plans": "plan", "results": "result", "certificates": "certificate", "measures": "measures"}
        compared = {name: [outputs[key] for outputs in made.values()] for name, key in keys.items()}
        resolve("scripts.patients.show_plans:show_plans")(job.case, job.method, files["model"], compared, pages[-1])
    return pages, files["model"], imported


def bring(
    patient: Patient, folder: str, markups: list[str], covariates: Mapping | None, made: Mapping, kinds: Sequence[str]
) -> None:
    """Import kinds of what is brought of a patient, covariates, labels, surfaces or plan, to the files of IMPORTED."""
    config = patient.config
    params = {**config, **config["osteotomy"], "bone_edge": config["mesh"]["bone_edge"], "foreign": True}
    params |= {key: config["registration"][f"segment_{key}"] for key in ("limit", "share")}
    files = {"segmentation": patient.segmentation, "volume": patient.volume or None, "markups": markups, **made}
    parts = [
        ("covariates", "covariates", folder, {"covariates": f"{folder}/covariates.json"}),
        ("labels", "segmentation", folder, {"labels": made["labels"]}),
        ("surfaces", "segmentation", folder, {name: made[name] for name in SURFACES}),
        *(("plan", "plan", f"{folder}/{plan}", {"plan": f"{folder}/{plan}/plan.json"}) for plan in patient.plans),
    ]
    for kind, rule, place, outputs in parts:
        if kind in kinds:
            import_case(
                case=patient.name,
                files=files | {"source": patient.plans.get(Path(place).name)},
                outputs=outputs,
                **settings_of(params),
                known=covariates if kind == "covariates" else None,
                record=f"{place}/.import_{rule}.json",
            )


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("keys", nargs="+", metavar="KEY=VALUE", help="keys of the configuration, values as in YAML")
    parser.add_argument("--configfile", nargs="*", default=[], help="files laid over config/config.yaml")
    options = parser.parse_args()
    try:
        files = [ROOT / "config/config.yaml", *options.configfile]
        for file in files:
            refuse_doubled(file)
        layers = [yaml.load(Path(file).read_text("utf-8"), yaml.CSafeLoader) or {} for file in files]
        pairs = (word.partition("=") for word in options.keys)
        layers += ({key: value if key in PATHS else yaml.safe_load(value)} for key, _, value in pairs)
        config = checked(reduce(overlaid, layers), read_schema(ROOT))
        check_config(config)
        predict_new(config)
    except (InputError, StorageError, yaml.YAMLError) as error:
        print(error, flush=True)  # standard error goes to the log by now
        sys.exit(1)
