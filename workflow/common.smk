"""Cohort, folds and the helper functions of the rules."""

import os
from pathlib import Path

from snakemake.logging import logger
from snakemake.utils import validate

from pinnochio.errors import InputError
from pinnochio.files import check_writable
from pinnochio.patients.archive import READ_BY_NETWORKS, configuration_hash
from pinnochio.patients.choice import choose
from pinnochio.patients.new import read_patients
from pinnochio.report.parts import PARTS
from pinnochio.code import LIBRARY, code_hash
from pinnochio.study.cases import assign_folds, external_file, read_cases, virtual_cases
from pinnochio.study.configuration import (
    check_config,
    left_out,
    surface_networks,
    variants,
)
from pinnochio.experiments.tradeoff_settings import network_settings

# Idle OpenMP threads of a job sleep; spinning they take the cores from the compiled loops.
os.environ.setdefault("OMP_WAIT_POLICY", "passive")
# No job takes more cores than it asks for.
os.environ.setdefault("IGL_NUM_THREADS", "1")
os.environ.setdefault("ITK_GLOBAL_DEFAULT_NUMBER_OF_THREADS", "1")

validate(config, "schemas/config.schema.yaml")
check_config(config)

SCRIPTS = (
    Path(workflow.current_basedir.get_path_or_uri(secret_free=True)).parent / "scripts"
)
RESULTS = config["pathvars"]["results"]
BENCHMARKS = f"{RESULTS}/benchmarks"
# A job of a cluster does not hear of --resources: it asks its step for a GPU only where SLURM has granted it one.
GPU = int(not workflow.remote_exec or "SLURM_GPUS_ON_NODE" in os.environ)
VIRTUAL = config["cohort"] == "virtual"
COHORT = "virtual cohort" if VIRTUAL else Path(config["cohort"]).stem
SEED = config["seed"]

CASES = {
    case.name: case
    for case in (
        virtual_cases(config["virtual"]["patients"], f"{RESULTS}/virtual")
        if VIRTUAL
        else read_cases(config["cohort"])
    )
}
# Every patient is predicted; only those with a post-operative scan can be trained on and judged.
SCANNED = [name for name, case in CASES.items() if case.postop]
UNSCANNED = [name for name, case in CASES.items() if not case.postop]
HELD_OUT = assign_folds(SCANNED, UNSCANNED, config["folds"], SEED)
LEFT_OUT = left_out(config, len(SCANNED))
if LEFT_OUT and workflow.is_main_process:
    logger.warning(
        f"Left out: {', '.join(LEFT_OUT)}. Training by cross-validation needs a post-operative scan of at least "
        f"one patient per fold; {len(SCANNED)} of {len(CASES)} patients have one, and 'folds' is {config['folds']}."
    )
EXTERNAL = config["external"]
METHODS = [name for name in [*config["methods"], *EXTERNAL] if name not in LEFT_OUT]
# Settings of every learned method, those of the design study included, which are predicted only if asked for.
VARIANTS = variants(config)
SURFACE = surface_networks(config)
SETTINGS = VARIANTS | SURFACE
LEARNED = [method for method in METHODS if method in SETTINGS]
CORRECTIONS = [name for name in config["corrections"]["methods"] if name in LEARNED]
UNCERTAIN = [name for name in config["uncertainty"]["methods"] if name in LEARNED]
SCALED = [name for name in config["scaling"]["methods"] if name in LEARNED]
# The patient that is carried through every size of mesh, and those whose stages are added up.
MEASURED = next(iter(SCANNED or CASES))
COUNTS = sorted({min(count, len(CASES)) for count in config["scaling"]["patients"]})
COUNTED = list(CASES)[: COUNTS[-1]]
DESIGN = [
    config["design"]["base"],
    *(name for name in VARIANTS if name.startswith("design_")),
]
# The ablation table wants all of its variants, if there are any.
ABLATED = SCANNED and config["ablation"] and set(config["ablation"]) <= set(LEARNED)
# Of what decides about the models, not of where files lie and who is predicted.
CONFIGURATION = configuration_hash(
    {
        key: value
        for key, value in config.items()
        if key not in ("pathvars", "patient", "models", "predict", "report")
    }
)
# What is packed for new patients: every method with an interval, and the one that shall predict them.
PACKED = [
    name
    for name in dict.fromkeys(
        [*config["uncertainty"]["methods"], config["predict"]["method"]]
    )
    if name in VARIANTS and name in LEARNED
]
PATIENTS = read_patients(config["patient"]) if config["patient"] else {}
PLANS = sorted({plan for patient in PATIENTS.values() for plan in patient.plans})
# Asked for with a new patient alone: a study needs no archive.
FRONT = config["predict"]["pareto_front"] or f"{RESULTS}/tables/tradeoff.csv"
CHOICE = (
    choose(config, config["models"] or f"{RESULTS}/archive", FRONT)
    if PATIENTS
    else None
)
if CHOICE and CHOICE.expected and workflow.is_main_process:
    logger.info(
        "Chosen from the measured Pareto front: {setting}, {seconds:.3g} s per plan ({seconds_max:.3g} s on the slowest of "
        "{patients} patients); to expect: {cd:.2f} mm from the outcome, {face_error:.2f} mm from the reference "
        "solution in the mean.".format(**CHOICE.expected)
    )
BETTER = SCANNED and config["design"]["base"] in METHODS
# The trade-off measures held-out patients of the first fold.
TRADEOFF = config["tradeoff"]
FIRST = next(iter(HELD_OUT))
TRADED = [case for case in HELD_OUT[FIRST] if case in SCANNED][: TRADEOFF["patients"]]
TRADED_NETWORKS = [*TRADEOFF["networks"], *TRADEOFF["further"]] if TRADED else []
NETWORK_SETTINGS = (
    network_settings(config["mesh"]["nodes"], TRADEOFF, VARIANTS) if TRADED else []
)
SIZES = sorted({config["mesh"]["nodes"], TRADEOFF["reference"], *TRADEOFF["nodes"]})
# Measured along their dials, so not once more as the study predicts by them.
AS_THEY_ARE = [
    method
    for method in METHODS
    if method not in ("elastic", "fem_bonded", "fem_sliding", *TRADED_NETWORKS)
]
LIFTS = sorted(
    {
        (kind, setting.nodes)
        for setting in NETWORK_SETTINGS
        if (kind := VARIANTS[setting.method]["network"]["lift"]) != "none"
    }
)
REFERENCE = config["reference"] if config["reference"] in METHODS else None
# Tables of the data card; the effects are measured on as many patients as the configuration says.
CARD_TABLES = ["thickness", "ratios"]
CARD_TABLES += ["effects"] if config["virtual"]["effects"] else []
ARMS = {
    "fem_bonded": "bonded",
    "fem_sliding": "mucosa",
    "fem_rlse_bonded": "bonded",
    "fem_rlse_mucosa": "mucosa",
    "fem_rlse": "mucosa+lip",
}
# How models are reduced to what a plan requires, and the patients on whom that is measured.
SCENE = {
    key: value
    for key, value in config["scene"].items()
    if key not in ("mode", "patients")
}
SCENE_CASES = list(CASES)[: config["scene"]["patients"]]
SCENE_FOLDER = "scene" if VIRTUAL else "cases"
SCENE_SEGMENTS = list(
    dict.fromkeys([*config["segments"], *(["chin"] if VIRTUAL else [])])
)
IN_SCENE = (
    {"fem_bonded", "fem_sliding", "elastic"}
    if config["scene"]["mode"] == "auto"
    else set()
)
# Whom the report shows, and the networks whose volume it shows: with and without physics, and the better one.
SHOWN = SCANNED[: config["report"]["patients"]]
VOLUMES = [
    method
    for method in dict.fromkeys([*config["ablation"], config["design"]["base"]])
    if method in LEARNED
]
# Predicted on the mesh that resolves the lips.
ON_LIPS = {"fem_rlse_bonded", "fem_rlse_mucosa", "fem_rlse"}


def segmentation_of(wildcards):
    return CASES[wildcards.case].segmentation


def plan_of(wildcards):
    return CASES[wildcards.case].plan


def postop_of(wildcards):
    case = CASES[wildcards.case]
    if not case.postop:
        raise InputError(
            case.name,
            config["cohort"],
            "there is no post-operative scan",
            "ask for fem/mucosa.png, or give a scan",
        )
    return case.postop


def of_held_out(pattern):
    """Input function: `pattern` for each held-out case of the fold."""
    return lambda wildcards: expand(pattern, case=HELD_OUT[wildcards.fold])


def model_of(case, method):
    """The model that the method predicts the case on."""
    own = "lips/" if method in ON_LIPS else "scene/" if method in IN_SCENE else ""
    return expand(f"<results>/cases/{{case}}/{own}model.h5", case=case)


def models_of_held_out(wildcards):
    """The models that the method predicts the held-out cases of the fold on."""
    return model_of(HELD_OUT[wildcards.fold], wildcards.method)


def of_training(pattern):
    """Input function: `pattern` for each training case of the fold, which no held-out case is."""
    return lambda wildcards: expand(pattern, case=training_cases(wildcards))


def of_scanned(pattern):
    """Input function: `pattern` for each held-out case of the fold that can be judged."""
    return lambda wildcards: expand(pattern, case=scanned_of(wildcards))


def lifts_of(names):
    """Input function: the lifts of the cases that names(wildcards) gives, if the method's network wants one."""

    def found(wildcards):
        lift = VARIANTS[wildcards.method]["network"]["lift"]
        pattern = f"<results>/cases/{{case}}/lift_{lift}.h5"
        return [] if lift == "none" else expand(pattern, case=names(wildcards))

    return found


def fem_of(wildcards):
    """The settings of finite elements of the method."""
    if wildcards.method not in ON_LIPS:
        return config["fem"]
    own = {
        key: config["fem_rlse"][key]
        for key in ("increments", "tolerance", "time_limit")
    }
    return config["fem"] | own


def settings_of(section):
    """Params function: a section of the settings of the method."""
    return lambda wildcards: SETTINGS[wildcards.method][section]


def archived(wildcards):
    """The archive of the study, where it trains what is to be packed."""
    if not PACKED:
        raise InputError(
            "-",
            "configuration",
            "no method of uncertainty.methods and predict.method is trained here",
            "add one to 'methods', with a scan of at least one patient per fold",
        )
    return rules.pack.output


def named_patients():
    """The new patients; InputError where none is named."""
    if not PATIENTS:
        raise InputError(
            "-",
            "configuration",
            "no new patient is named",
            "add --config patient=FOLDER",
        )
    return PATIENTS.values()


def results_of_patients(wildcards):
    """What is handed over of every new patient and plan."""
    for patient in named_patients():
        if not patient.plans:
            raise InputError(
                patient.name,
                patient.home,
                "there is no plan",
                "add plan.json, or plans/NAME.json for several, or make one with the planner (make planner)",
            )
    names = ["certificate.json", "index.html", "deformed.vtu"]
    return [
        f"<results>/patients/{patient.name}/{plan}/{CHOICE.method}/{name}"
        for patient in PATIENTS.values()
        for plan in patient.plans
        for name in names
    ]


def planners_of_patients(wildcards):
    """What the planner needs of every new patient."""
    found = expand(
        "<results>/patients/{case}/planner.json",
        case=[patient.name for patient in named_patients()],
    )
    if not CHOICE.archive:
        raise InputError(
            "-",
            "configuration",
            f"the planner shows the interval of a trained method, and {CHOICE.method} has none",
            "leave predict.method, budget_seconds and tolerance_mm as they are, or name a method of the archive",
        )
    return found


def plans_of_patient(wildcards):
    """The checked plans of a new patient."""
    return expand(
        "<results>/patients/{case}/{plan}/plan.json",
        case=wildcards.case,
        plan=PATIENTS[wildcards.case].plans,
    )


def lift_of_patient(wildcards):
    """The lift of a new patient, if the chosen network wants one."""
    pattern = f"<results>/patients/{{case}}/lift_{CHOICE.lift}.h5"
    return [] if CHOICE.lift == "none" else expand(pattern, case=wildcards.case)


def result_of_patient(wildcards):
    """The file that holds the displacement, and the interval of a learned method."""
    name = "interval" if CHOICE.archive else "predictions"
    return f"<results>/patients/{{case}}/{{plan}}/{{method}}/{name}.h5"


def chosen(section):
    """Params function: a section of the settings that a new patient is predicted with."""
    return lambda wildcards: CHOICE.settings[section]


def sized(nodes, file):
    """A file of the patient on the mesh of so many nodes; the study's own where it has that size."""
    own = nodes == config["mesh"]["nodes"]
    return f"<results>/{'cases' if own else f'sizes/{nodes}'}/{{case}}/{file}"


def rows_of_traded(wildcards):
    if len(TRADED) < 2:
        raise InputError(
            "-",
            config["cohort"],
            f"{len(TRADED)} patients of fold {FIRST} have a post-operative scan, and the trade-off wants two",
            "lower 'folds', raise tradeoff.patients, or give more scans",
        )
    return expand(
        "<results>/tradeoff/{case}/{family}.csv",
        case=TRADED,
        family=["fem", "networks", "study"],
    )


def external_files(wildcards):
    """The files in which an external method delivers the held-out cases of the fold."""
    folder = EXTERNAL[wildcards.method]
    return [external_file(folder, case) for case in HELD_OUT[wildcards.fold]]


def tables_of_report(wildcards):
    """The tables of the study, and of the further targets that have been made already, which are brought up to date."""
    own = [*rules.tables.input, *rules.quality.input, *rules.cost.input]
    names = {Path(path).stem for path in own}
    return [
        f"<results>/tables/{name}.html"
        for name in PARTS
        if name in names or Path(f"{RESULTS}/tables/{name}.html").exists()
    ]


def figures_of_report(wildcards):
    """The figures of the further targets that have been made already."""
    return [
        f"<results>/figures/{name}.png"
        for name in PARTS
        if Path(f"{RESULTS}/figures/{name}.png").exists()
    ]


def captioned(path, name=None):
    """An output that `snakemake --report` shows: with the caption of that name, by default the file's own."""
    name = name or Path(path).stem
    caption = f"../workflow/report/{name}.rst"
    return report(path, caption=caption, category=PARTS.get(name, "Patients"))


def fold_of(case):
    """Fold that holds the case out."""
    return next(fold for fold, cases in HELD_OUT.items() if case in cases)


def held_out(wildcards):
    return HELD_OUT[wildcards.fold]


def scanned_of(wildcards):
    return [name for name in HELD_OUT[wildcards.fold] if name in SCANNED]


def training_cases(wildcards):
    return [name for name in SCANNED if name not in HELD_OUT[wildcards.fold]]


def code_of(*names):
    """Content hash of stage scripts, of modules that they call by name ("tables.cases"), and of all that these import.

    An edit of an imported module triggers no rerun by itself; this parameter does.
    """
    return code_hash(
        *(
            (LIBRARY if "." in name else SCRIPTS) / f"{name.replace('.', '/')}.py"
            for name in names
        )
    )


onstart:
    check_writable(RESULTS)
