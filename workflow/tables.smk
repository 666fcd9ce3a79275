"""What every table of the study is made of: its files, its arguments, and what must be there before it beside these.

`tabulate` of its module takes both; the module is pinnochio.tables.{name of the table} where nothing else is said.
"""

TWINS = ["md", "tex", "html"]
METRICS = "<results>/folds/{fold}/{method}/metrics.csv"
SKINS = "<results>/folds/{fold}/{method}/skins.h5"
JUDGED = {"cases": "<results>/tables/cases.csv"}
ANATOMIES = {
    "anatomies": expand(
        "<results>/virtual/{case}/anatomy.json", case=STUDY.cohort.cases
    )
}
NAMED = {"cohort": COHORT}
COMPARED = NAMED | {
    "reference": STUDY.methods.reference,
    "methods": STUDY.methods.compared,
    "bounds": STUDY.methods.bounds,
    "seed": SEED,
}
MODULES = {
    "better": "pinnochio.tables.accuracy",
    "anatomy": "pinnochio.virtual.description",
}
# Files by argument, and the other arguments.
TABLES = {
    "cases": (
        {
            "metrics": expand(
                METRICS, fold=STUDY.folds.held_out, method=STUDY.methods.used
            ),
            "skins": expand(
                SKINS, fold=STUDY.folds.held_out, method=STUDY.methods.used
            ),
        },
        NAMED | {"bounds": STUDY.methods.bounds},
    ),
    "accuracy": (JUDGED, COMPARED | {"published": True}),
    # The same with every method tested against the better network.
    "better": (
        JUDGED,
        COMPARED | {"reference": config["better"], "published": False},
    ),
    "regions": (JUDGED, COMPARED),
    # The same networks and solvers, given the plan instead of the achieved motion.
    "planned": (
        {
            arm: expand(
                METRICS.replace("folds", folder, 1),
                fold=STUDY.folds.held_out,
                method=STUDY.planned,
            )
            for arm, folder in (("achieved", "folds"), ("planned", "planned"))
        },
        NAMED | {"cases": STUDY.both_motions, "methods": STUDY.planned, "seed": SEED},
    ),
    "segments": (
        {
            "fits": expand(
                "<results>/cases/{case}/segments.csv", case=STUDY.cohort.registered
            ),
            **(
                {
                    "achieved": expand(
                        "<results>/cases/{case}/achieved.json",
                        case=STUDY.cohort.registered,
                    ),
                    "executed": expand(
                        "<results>/virtual/{case}/executed.json",
                        case=STUDY.cohort.registered,
                    ),
                    "bones": expand(
                        "<results>/cases/{case}/bone.vtp", case=STUDY.cohort.registered
                    ),
                }
                if STUDY.cohort.virtual
                else {}
            ),
        },
        NAMED | {"cases": STUDY.cohort.registered},
    ),
    "landmarks": (JUDGED, COMPARED),
    "ablation": (
        JUDGED,
        NAMED
        | {"variants": {m: NETWORKS[m] for m in config["ablation"]}, "seed": SEED},
    ),
    "claims": (
        JUDGED,
        NAMED | {"seed": SEED},
    ),
    "coverage": (
        {
            "parts": expand(
                "<results>/methods/{method}/coverage.csv",
                method=STUDY.methods.calibrated,
            )
        },
        NAMED,
    ),
    "training": (
        {
            "networks": expand(
                "<results>/folds/{fold}/{method}/network.pt",
                method=STUDY.methods.learned,
                fold=STUDY.folds.held_out,
            ),
            "histories": INPUTS.training.histories,
        },
        NAMED
        | {
            "settings": {
                method: STUDY.methods.phases(method) for method in STUDY.methods.learned
            },
            "folds": list(STUDY.folds.held_out),
            "benchmarks": BENCHMARKS,
            "rule": config["convergence"],
        },
    ),
    "stages": ({}, NAMED | {"benchmarks": BENCHMARKS}),
    "quality": (
        {
            "reports": expand(
                "<results>/cases/{case}/quality.json", case=STUDY.cohort.cases
            )
        },
        NAMED | {"segments": config["segments"]},
    ),
    "anatomy": (ANATOMIES, NAMED),
}
# What must be there before a table beside its files; the benchmark files differ from run to run and are no input.
BEFORE = {
    "stages": [
        *expand(
            "<results>/tables/{table}.csv",
            table=[*INPUTS.tables.measured, "quality", *INPUTS.tables.costs[1:]],
        ),
        *expand("<results>/cases/{case}/fem/mucosa.json", case=STUDY.cohort.unscanned),
    ]
}


# What further studies add: titles of their parts of the report, captions, and the modules that draw a table.
FURTHER = {"coverage": "Coverage of the intervals"}
CAPTIONS = {}
FIGURES = {"cases": "pinnochio.figures.cases"}


def add_table(name, module, caption, files, arguments, title="", figure=""):
    """Register a table of a study: `tabulate` of the module makes it, `draw` of the figure's its picture, if any.

    With a title it is a part of the report that `report.further` may name.
    """
    TABLES[name], MODULES[name], CAPTIONS[name] = (files, arguments), module, caption
    if title:
        FURTHER[name] = title
    if figure:
        FIGURES[name] = figure


def reported():
    """Titles of the parts of the report, in its order: the study's tables and what the configuration adds."""
    if unknown := set(config["report"]["further"]) - set(FURTHER):
        raise InputError(
            "-",
            "configuration",
            f"report.further names {min(unknown)!r}, which is no further study",
            f"known are {', '.join(FURTHER)}",
        )
    names = {
        *INPUTS.tables.measured,
        *INPUTS.tables.costs,
        "quality",
        *config["report"]["further"],
    }
    first = {name: title for name, title in PARTS.items() if name not in FOLDED}
    return {
        name: title
        for name, title in (first | FURTHER | PARTS).items()
        if name in names
    }


def table_and_twins(*names, folder="tables"):
    """The CSV file and the readable twins of tables of the study."""
    return expand(
        "<results>/{folder}/{table}.{kind}",
        folder=folder,
        table=names,
        kind=["csv", *TWINS],
    )


def recorded(name, folder="tables"):
    """A table that a target of its own makes, its readable twins, and the record of the run that made it."""
    return [
        *table_and_twins(name, folder=folder),
        f"<results>/{folder}/{name}.provenance.json",
    ]


def files_of_table(wildcards):
    files, _ = TABLES[wildcards.table]
    return files(wildcards) if callable(files) else files


def module_of(wildcards):
    """The module that makes the table."""
    return MODULES.get(wildcards.table, f"pinnochio.tables.{wildcards.table}")


def caption(name):
    """What reports say of a part."""
    if name in CAPTIONS:
        return CAPTIONS[name]
    return (ROOT / f"workflow/report/{name}.rst").read_text(encoding="utf-8")


def caption_of(wildcards):
    """What Snakemake's own report says of a table and its picture."""
    return caption(wildcards.table)


def part_of(wildcards):
    """The category of Snakemake's own report that a table and its picture stand in."""
    return (PARTS | FURTHER).get(wildcards.table, "Further tables")
