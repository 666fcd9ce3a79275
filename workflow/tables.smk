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
ANATOMIES = {"anatomies": expand("<results>/virtual/{case}/anatomy.json", case=CASES)}
NAMED = {"cohort": COHORT}
COMPARED = NAMED | {"reference": REFERENCE, "methods": METHODS, "seed": SEED}
SUMS = NAMED | {"benchmarks": BENCHMARKS, "cases": list(CASES), "counts": COUNTS}
# The benchmark files differ from run to run and are no input; the jobs that write them are asked for by what they make.
COUNTED_FILES = expand("<results>/cases/{case}/quality.json", case=COUNTED) + expand(
    "<results>/cases/{case}/{file}",
    case=[name for name in COUNTED if name in SCANNED],
    file=["postop.h5", "fem_samples.h5"] if LEARNED else ["postop.h5"],
)
MODULES = {
    "better": "tables.accuracy",
    "scene": "tables.reductions",
    "thickness": "virtual.thickness",
    "anatomy": "virtual.description",
    "effects": "virtual.effects",
    "ratios": "virtual.ratios",
}
# Files by argument, and the other arguments.
TABLES = {
    "cases": ({"metrics": expand(METRICS, fold=HELD_OUT, method=METHODS)}, NAMED),
    "accuracy": (JUDGED, COMPARED | {"published": True}),
    # The same with every method tested against the better network.
    "better": (
        JUDGED,
        COMPARED | {"reference": config["design"]["base"], "published": False},
    ),
    "regions": (JUDGED, COMPARED),
    "landmarks": (JUDGED, COMPARED),
    "ablation": (
        JUDGED,
        NAMED
        | {"variants": {m: VARIANTS[m] for m in config["ablation"]}, "seed": SEED},
    ),
    "design": (
        {
            "metrics": expand(
                METRICS, fold=list(HELD_OUT)[: config["design"]["folds"]], method=DESIGN
            )
        },
        NAMED | {"variants": {m: VARIANTS[m] for m in DESIGN}, "seed": SEED},
    ),
    "corrections": (
        {
            "metrics": [
                f"<results>/folds/{fold}/{method}/{name}.csv"
                for method in CORRECTIONS
                for name in [
                    "metrics",
                    *(
                        f"corrected_{count}"
                        for count in config["corrections"]["counts"]
                    ),
                ]
                for fold in HELD_OUT
            ]
        },
        NAMED
        | {
            "methods": CORRECTIONS,
            "corrections": [0, *config["corrections"]["counts"]],
            "seed": SEED,
        },
    ),
    "scene": (
        {"trials": expand("<results>/scene/{case}/trials.csv", case=SCENE_CASES)},
        NAMED,
    ),
    "coverage": (
        {"parts": expand("<results>/methods/{method}/coverage.csv", method=UNCERTAIN)},
        NAMED,
    ),
    "tradeoff_cases": (lambda wildcards: {"rows": rows_of_traded(wildcards)}, NAMED),
    "choices": (
        TRADED_CASES,
        NAMED | {"budgets": TRADEOFF["budgets"], "tolerances": TRADEOFF["allowed"]},
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
            "held_out": HELD_OUT,
            "training": {
                fold: len([name for name in SCANNED if name not in cases])
                for fold, cases in HELD_OUT.items()
            },
            "methods": METHODS,
            "nodes": config["mesh"]["nodes"],
            "cluster": config["scaling"]["cluster"],
        },
    ),
    "scaling_patients": ({}, SUMS),
    "scaling_exponents": (SIZED, SUMS),
    "training": (
        {
            "networks": expand(
                "<results>/folds/{fold}/{method}/network.pt",
                method=LEARNED,
                fold=HELD_OUT,
            )
        },
        NAMED
        | {
            "settings": {
                method: {
                    phase: SETTINGS[method].get(phase)
                    for phase in ("pretraining", "finetuning")
                }
                for method in LEARNED
            },
            "folds": list(HELD_OUT),
            "benchmarks": BENCHMARKS,
        },
    ),
    "stages": ({}, NAMED | {"benchmarks": BENCHMARKS}),
    "quality": (
        {"reports": expand("<results>/cases/{case}/quality.json", case=CASES)},
        NAMED | {"segments": config["segments"]},
    ),
    "thickness": (ANATOMIES, {}),
    "anatomy": (ANATOMIES, {}),
    "effects": (
        {
            "rows": expand(
                "<results>/virtual/{case}/effects.csv",
                case=list(CASES)[: config["virtual"]["effects"]],
            )
        },
        {"reality": config["virtual"]["reality"]},
    ),
    "ratios": (
        {
            "landmarks": expand("<results>/virtual/{case}/landmarks.json", case=CASES),
            "truths": expand("<results>/virtual/{case}/truth.h5", case=CASES),
        },
        {"cases": list(CASES)},
    ),
}
# Those of the target `tables`, and of the target `cost`.
STUDIED = [
    "cases",
    *(["accuracy", "regions"] if SCANNED else []),
    *(["better"] if BETTER else []),
    *(["landmarks"] if SCANNED and VIRTUAL else []),
    *(["ablation"] if ABLATED else []),
]
COSTS = ["stages", *(["training"] if LEARNED else [])]
BEFORE = dict.fromkeys(
    ("scaling", "scaling_patients", "scaling_exponents"), COUNTED_FILES
)
# Last of all.
BEFORE["stages"] = [
    *expand("<results>/tables/{table}.csv", table=[*STUDIED, "quality", *COSTS[1:]]),
    *expand("<results>/cases/{case}/fem/mucosa.json", case=UNSCANNED),
]


def table_and_twins(*names):
    """The CSV file and the readable twins of tables of the study."""
    return expand("<results>/tables/{table}.{kind}", table=names, kind=["csv", *TWINS])


def files_of_table(wildcards):
    files, _ = TABLES[wildcards.table]
    return files(wildcards) if callable(files) else files


def module_of(wildcards):
    """The module of pinnochio that makes the table."""
    return MODULES.get(wildcards.table, f"tables.{wildcards.table}")


def caption_of(wildcards):
    """What Snakemake's own report says of a table and its picture."""
    path = SCRIPTS.parent / f"workflow/report/{wildcards.table}.rst"
    return path.read_text(encoding="utf-8")


def part_of(wildcards):
    """The category of Snakemake's own report that a table and its picture stand in."""
    return PARTS.get(wildcards.table, "Further tables")
