"""What every table of the study is made of.

By the name of the table: module of pinnochio whose `tabulate` makes it, the files and arguments that this takes, and
what must be there before it beside these files.
"""

TWINS = ["md", "tex", "html"]
METRICS = "<results>/folds/{fold}/{method}/metrics.csv"
COMPARED = {"cohort": COHORT, "reference": REFERENCE, "methods": METHODS, "seed": SEED}
JUDGED = {"cases": "<results>/tables/cases.csv"}
TRADED_CASES = {"cases": "<results>/tables/tradeoff_cases.csv"}
SIZED = {
    "sizes": expand("<results>/scaling/{nodes}.csv", nodes=config["scaling"]["nodes"])
}
# The benchmark files differ from run to run and are no input; the jobs that write them are asked for by what they make.
COUNTED_FILES = expand("<results>/cases/{case}/quality.json", case=COUNTED) + expand(
    "<results>/cases/{case}/{file}",
    case=[name for name in COUNTED if name in SCANNED],
    file=["postop.h5", "fem_samples.h5"] if LEARNED else ["postop.h5"],
)
SUMS = {
    "benchmarks": BENCHMARKS,
    "cases": list(CASES),
    "counts": COUNTS,
    "cohort": COHORT,
}
ANATOMIES = {"anatomies": expand("<results>/virtual/{case}/anatomy.json", case=CASES)}

TABLES = {
    "cases": {
        "module": "tables.cases",
        "files": {"metrics": expand(METRICS, fold=HELD_OUT, method=METHODS)},
        "arguments": {"cohort": COHORT},
    },
    "accuracy": {
        "module": "tables.accuracy",
        "files": JUDGED,
        "arguments": COMPARED | {"published": True},
    },
    # The same table with every method tested against the better network.
    "better": {
        "module": "tables.accuracy",
        "files": JUDGED,
        "arguments": COMPARED
        | {"reference": config["design"]["base"], "published": False},
    },
    "regions": {"module": "tables.regions", "files": JUDGED, "arguments": COMPARED},
    "landmarks": {"module": "tables.landmarks", "files": JUDGED, "arguments": COMPARED},
    "ablation": {
        "module": "tables.ablation",
        "files": JUDGED,
        "arguments": {
            "variants": {name: VARIANTS[name] for name in config["ablation"]},
            "cohort": COHORT,
            "seed": SEED,
        },
    },
    # On the first folds.
    "design": {
        "module": "tables.design",
        "files": {
            "metrics": expand(
                METRICS,
                fold=list(HELD_OUT)[: config["design"]["folds"]],
                method=DESIGN,
            )
        },
        "arguments": {
            "variants": {name: VARIANTS[name] for name in DESIGN},
            "cohort": COHORT,
            "seed": SEED,
        },
    },
    "corrections": {
        "module": "tables.corrections",
        "files": {
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
        "arguments": {
            "methods": CORRECTIONS,
            "corrections": [0, *config["corrections"]["counts"]],
            "cohort": COHORT,
            "seed": SEED,
        },
    },
    "scene": {
        "module": "tables.reductions",
        "files": {
            "trials": expand("<results>/scene/{case}/trials.csv", case=SCENE_CASES)
        },
        "arguments": {"cohort": COHORT},
    },
    "coverage": {
        "module": "tables.coverage",
        "files": {
            "parts": expand("<results>/methods/{method}/coverage.csv", method=UNCERTAIN)
        },
        "arguments": {"cohort": COHORT},
    },
    "tradeoff_cases": {
        "module": "tables.tradeoff_cases",
        "files": lambda wildcards: {"rows": rows_of_traded(wildcards)},
        "arguments": {"cohort": COHORT},
    },
    "choices": {
        "module": "tables.choices",
        "files": TRADED_CASES,
        "arguments": {
            "budgets": TRADEOFF["budgets"],
            "tolerances": TRADEOFF["allowed"],
            "cohort": COHORT,
        },
    },
    "tradeoff": {
        "module": "tables.tradeoff",
        "files": TRADED_CASES | {"choices": "<results>/tables/choices.json"},
        "arguments": {"cohort": COHORT},
    },
    "scaling": {
        "module": "tables.scaling",
        "files": SIZED,
        "after": COUNTED_FILES,
        "arguments": SUMS
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
    },
    "scaling_patients": {
        "module": "tables.scaling_patients",
        "after": COUNTED_FILES,
        "arguments": SUMS,
    },
    "scaling_exponents": {
        "module": "tables.scaling_exponents",
        "files": SIZED,
        "after": COUNTED_FILES,
        "arguments": SUMS,
    },
    "training": {
        "module": "tables.training",
        "files": {
            "networks": expand(
                "<results>/folds/{fold}/{method}/network.pt",
                method=LEARNED,
                fold=HELD_OUT,
            )
        },
        "arguments": {
            "settings": {
                method: {
                    phase: SETTINGS[method].get(phase)
                    for phase in ("pretraining", "finetuning")
                }
                for method in LEARNED
            },
            "folds": list(HELD_OUT),
            "benchmarks": BENCHMARKS,
            "cohort": COHORT,
        },
    },
    "quality": {
        "module": "tables.quality",
        "files": {"reports": expand("<results>/cases/{case}/quality.json", case=CASES)},
        "arguments": {"segments": config["segments"], "cohort": COHORT},
    },
    "thickness": {"module": "virtual.thickness", "files": ANATOMIES},
    "anatomy": {"module": "virtual.description", "files": ANATOMIES},
    "effects": {
        "module": "virtual.effects",
        "files": {
            "rows": expand(
                "<results>/virtual/{case}/effects.csv",
                case=list(CASES)[: config["virtual"]["effects"]],
            )
        },
        "arguments": {"reality": config["virtual"]["reality"]},
    },
    "ratios": {
        "module": "virtual.ratios",
        "files": {
            "landmarks": expand("<results>/virtual/{case}/landmarks.json", case=CASES),
            "truths": expand("<results>/virtual/{case}/truth.h5", case=CASES),
        },
        "arguments": {"cases": list(CASES)},
    },
}
# Those of the target `tables`.
STUDIED = [
    "cases",
    *(["accuracy", "regions"] if SCANNED else []),
    *(["better"] if BETTER else []),
    *(["landmarks"] if SCANNED and VIRTUAL else []),
    *(["ablation"] if ABLATED else []),
]
COSTS = ["stages", *(["training"] if LEARNED else [])]
# Last of all, when the other tables are made.
TABLES["stages"] = {
    "module": "tables.stages",
    "after": [
        *expand(
            "<results>/tables/{table}.csv", table=[*STUDIED, "quality", *COSTS[1:]]
        ),
        *expand("<results>/cases/{case}/fem/mucosa.json", case=UNSCANNED),
    ],
    "arguments": {"benchmarks": BENCHMARKS, "cohort": COHORT},
}


def table_and_twins(*names):
    """The CSV file and the readable twins of tables of the study."""
    return expand("<results>/tables/{table}.{kind}", table=names, kind=["csv", *TWINS])


def files_of_table(wildcards):
    files = TABLES[wildcards.table].get("files", {})
    return files(wildcards) if callable(files) else files


def code_of_table(wildcards):
    return code_of("tabulate", TABLES[wildcards.table]["module"])


def caption_of(wildcards):
    """What Snakemake's own report says of a table and its picture."""
    path = SCRIPTS.parent / f"workflow/report/{wildcards.table}.rst"
    return path.read_text(encoding="utf-8")


def part_of(wildcards):
    """The category of Snakemake's own report that a table and its picture stand in."""
    return PARTS.get(wildcards.table, "Further tables")
