"""Cohort, folds and the helper functions of the rules."""

from pathlib import Path

from snakemake.utils import validate

from pinnochio.study import (
    assign_folds,
    check_config,
    code_hash,
    read_cases,
    virtual_cases,
)

validate(config, "schemas/config.schema.yaml")
check_config(config)

LIBRARY = Path(workflow.current_basedir.get_path_or_uri(secret_free=True)) / "pinnochio"
RESULTS = config["pathvars"]["results"]
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
# Only patients with a post-operative scan can be trained on and judged.
SCANNED = [name for name, case in CASES.items() if case.postop]
UNSCANNED = [name for name, case in CASES.items() if not case.postop]
HELD_OUT = assign_folds(SCANNED, config["folds"], SEED)
LEARNED = [method for method in config["methods"] if method == "pinnochio"]
ARMS = {"fem_bonded": "bonded", "fem_sliding": "mucosa"}


def segmentation_of(wildcards):
    return CASES[wildcards.case].segmentation


def plan_of(wildcards):
    return CASES[wildcards.case].plan


def postop_of(wildcards):
    return CASES[wildcards.case].postop


def of_held_out(pattern):
    """Input function: `pattern` for each held-out case of the fold."""
    return lambda wildcards: expand(pattern, case=HELD_OUT[wildcards.fold])


def of_training(pattern):
    """Input function: `pattern` for each training case of the fold, which no held-out case is."""
    return lambda wildcards: expand(pattern, case=training_cases(wildcards))


def fold_of(case):
    """Fold that holds the case out."""
    return next(fold for fold, cases in HELD_OUT.items() if case in cases)


def held_out(wildcards):
    return HELD_OUT[wildcards.fold]


def training_cases(wildcards):
    return [name for name in SCANNED if name not in HELD_OUT[wildcards.fold]]


def code_of(*rooms):
    """Content hash of the library's shared modules and of the named rooms.

    An edit of an imported module triggers no rerun by itself; this parameter does.
    """
    files = list(LIBRARY.glob("*.py"))
    for room in rooms:
        files += (LIBRARY / room).glob("*.py")
    return code_hash(files, LIBRARY)
