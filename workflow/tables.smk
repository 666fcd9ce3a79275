"""What every table of the study is made of: its files, its arguments, and what must be there before it beside these.

`tabulate` of its module takes both; the module is pinnochio.tables.{name of the table} where nothing else is said.
"""

TWINS = ["md", "tex", "html"]
METRICS = "<results>/folds/{fold}/{method}/metrics.csv"
JUDGED = {"cases": "<results>/tables/cases.csv"}
TRADED_CASES = {"cases": "<results>/tables/tradeoff_cases.csv"}
SIZED = {
    "sizes": expand("<results>/scaling/{nodes}.csv", nodes=config["scaling"]["nodes"])
}
ANATOMIES = {
    "anatomies": expand("<results>/virtual/{case}/anatomy.json", case=STUDY.cases)
}
NAMED = {"cohort": COHORT}
COMPARED = NAMED | {
    "reference": STUDY.reference,
    "methods": STUDY.compared,
    "bounds": STUDY.bounds,
    "seed": SEED,
}
SUMS = NAMED | {
    "benchmarks": BENCHMARKS,
    "cases": list(STUDY.cases),
    "counts": STUDY.counts,
}
# The benchmark files differ from run to run and are no input; the jobs that write them are asked for by what they make.
COUNTED_FILES = expand(
    "<results>/cases/{case}/quality.json", case=STUDY.counted
) + expand(
    "<results>/cases/{case}/{file}",
    case=[name for name in STUDY.counted if name in STUDY.scanned],
    file=["postop.h5", "judged.h5", *(["fem_samples.h5"] if STUDY.learned else [])],
)
MODULES = {
    "better": "pinnochio.tables.accuracy",
    "scene": "pinnochio.tables.reductions",
    "thickness": "pinnochio.virtual.thickness",
    "anatomy": "pinnochio.virtual.description",
    "effects": "pinnochio.virtual.effects",
    "ratios": "pinnochio.virtual.ratios",
    "nasolabial": "pinnochio.virtual.nasolabial",
    "reality": "pinnochio.virtual.reality",
    "learnable": "pinnochio.virtual.learnable",
    "refinement": "pinnochio.virtual.refinement",
}
# Files by argument, and the other arguments.
TABLES = {
    "cases": (
        {"metrics": expand(METRICS, fold=STUDY.held_out, method=STUDY.methods)},
        NAMED,
    ),
    "accuracy": (JUDGED, COMPARED | {"published": True}),
    # The same with every method tested against the better network.
    "better": (
        JUDGED,
        COMPARED | {"reference": config["design"]["base"], "published": False},
    ),
    "regions": (JUDGED, COMPARED),
    # The same networks and solvers, given the plan instead of the achieved motion.
    "planned": (
        {
            arm: expand(
                METRICS.replace("folds", folder, 1),
                fold=STUDY.held_out,
                method=STUDY.planned,
            )
            for arm, folder in (("achieved", "folds"), ("planned", "planned"))
        },
        NAMED | {"cases": STUDY.both_motions, "methods": STUDY.planned, "seed": SEED},
    ),
    "segments": (
        {
            "fits": expand(
                "<results>/cases/{case}/segments.csv", case=STUDY.registered
            ),
            **(
                {
                    "achieved": expand(
                        "<results>/cases/{case}/achieved.json", case=STUDY.registered
                    ),
                    "executed": expand(
                        "<results>/virtual/{case}/executed.json",
                        case=STUDY.registered,
                    ),
                    "bones": expand(
                        "<results>/cases/{case}/bone.vtp", case=STUDY.registered
                    ),
                }
                if STUDY.virtual
                else {}
            ),
        },
        NAMED | {"cases": STUDY.registered},
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
    "design": (
        {
            "metrics": expand(
                METRICS,
                fold=list(STUDY.held_out)[: config["design"]["folds"]],
                method=STUDY.design,
            )
        },
        NAMED | {"variants": {m: NETWORKS[m] for m in STUDY.design}, "seed": SEED},
    ),
    "learning": (
        lambda wildcards: STUDY.learning_metrics,
        NAMED
        | {
            "methods": config["learning"]["methods"],
            "untaught": STUDY.untaught,
            "patients": list(STUDY.learning_folds),
            "seed": SEED,
        },
    ),
    "corrections": (
        {
            "metrics": STUDY.corrected_metrics,
            "baseline": expand(
                METRICS,
                fold=STUDY.held_out,
                method=[BASELINE] if BASELINE in STUDY.methods else [],
            ),
        },
        NAMED
        | {
            "methods": STUDY.asked("corrections"),
            "corrections": [0, *config["corrections"]["counts"]],
            "seed": SEED,
        },
    ),
    "scene": (
        {
            "trials": expand(
                "<results>/scene/{case}/trials.csv", case=STUDY.reduced_cases
            )
        },
        NAMED,
    ),
    "inverse": (
        {
            kind: expand(f"<results>/inverse/{{case}}/{kind}.csv", case=STUDY.inverted)
            for kind in ("recovered", "faces", "marked", "seen")
        }
        | {"models": expand("<results>/cases/{case}/model.h5", case=STUDY.inverted)},
        NAMED
        | {
            "cases": STUDY.inverted,
            "held_out": STUDY.held_out,
            "tolerance": config["invert"]["tolerance"],
            "seed": SEED,
        },
    ),
    "coverage": (
        {
            "parts": expand(
                "<results>/methods/{method}/coverage.csv",
                method=STUDY.covered,
            )
        },
        NAMED,
    ),
    "tradeoff_cases": (
        lambda wildcards: {"rows": STUDY.rows_of_traded(wildcards)},
        NAMED,
    ),
    "choices": (
        TRADED_CASES,
        NAMED
        | {
            "budgets": config["tradeoff"]["budgets"],
            "tolerances": config["tradeoff"]["allowed"],
        },
    ),
    "tradeoff": (
        TRADED_CASES | {"choices": "<results>/tables/choices.json"},
        NAMED,
    ),
    "scaling": (
        SIZED,
        SUMS
        | {
            "results": RESULTS,
            "held_out": STUDY.held_out,
            "training": {
                fold: len([name for name in STUDY.scanned if name not in cases])
                for fold, cases in STUDY.held_out.items()
            },
            "methods": STUDY.methods,
            "nodes": config["mesh"]["nodes"],
            "cluster": config["scaling"]["cluster"],
        },
    ),
    "stability": (
        {"parts": expand("<results>/stability/{part}.csv", part=STUDY.extremes)},
        {},
    ),
    "scaling_patients": ({}, SUMS),
    "scaling_exponents": (SIZED, SUMS),
    "training": (
        {
            "networks": expand(
                "<results>/folds/{fold}/{method}/network.pt",
                method=STUDY.learned,
                fold=STUDY.held_out,
            ),
            "histories": STUDY.histories,
        },
        NAMED
        | {
            "settings": {method: STUDY.phases(method) for method in STUDY.learned},
            "folds": list(STUDY.held_out),
            "benchmarks": BENCHMARKS,
            "rule": config["convergence"],
        },
    ),
    "stages": ({}, NAMED | {"benchmarks": BENCHMARKS}),
    "quality": (
        {"reports": expand("<results>/cases/{case}/quality.json", case=STUDY.cases)},
        NAMED | {"segments": config["segments"]},
    ),
    "thickness": (ANATOMIES, NAMED),
    "anatomy": (ANATOMIES, NAMED),
    "effects": (
        {
            "rows": expand(
                "<results>/virtual/{case}/effects.csv",
                case=list(STUDY.cases)[: config["virtual"]["effects"]],
            )
        },
        NAMED
        | {key: config["virtual"]["outcome"][key] for key in ("effects", "reality")},
    ),
    "ratios": (
        {
            "landmarks": expand(
                "<results>/virtual/{case}/landmarks.json", case=STUDY.cases
            ),
            "truths": expand("<results>/virtual/{case}/truth.h5", case=STUDY.cases),
        },
        NAMED | {"cases": list(STUDY.cases)},
    ),
    "nasolabial": (
        {
            "rows": expand(
                "<results>/virtual/{case}/nasolabial.csv",
                case=list(STUDY.cases)[: config["virtual"]["effects"]],
            )
        },
        NAMED,
    ),
    "reality": (
        {"rows": expand("<results>/virtual/{case}/reality.csv", case=STUDY.cases)},
        NAMED,
    ),
    "learnable": (
        {"rows": expand("<results>/virtual/{case}/learnable.csv", case=STUDY.cases)},
        NAMED,
    ),
    "refinement": (
        {
            "rows": expand(
                "<results>/virtual/{case}/refinement.csv",
                case=list(STUDY.cases)[: config["virtual"]["refinement"]],
            )
        },
        NAMED,
    ),
}
BEFORE = dict.fromkeys(
    ("scaling", "scaling_patients", "scaling_exponents"), COUNTED_FILES
)
# Last of all.
BEFORE["stages"] = [
    *expand(
        "<results>/tables/{table}.csv",
        table=[*STUDY.tables, "quality", *STUDY.costs[1:]],
    ),
    *expand("<results>/cases/{case}/fem/mucosa.json", case=STUDY.unscanned),
]


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
    return (ROOT / f"workflow/report/{name}.rst").read_text(encoding="utf-8")


def caption_of(wildcards):
    """What Snakemake's own report says of a table and its picture."""
    return caption(wildcards.table)


def part_of(wildcards):
    """The category of Snakemake's own report that a table and its picture stand in."""
    return PARTS.get(wildcards.table, "Further tables")
