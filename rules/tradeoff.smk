# What a second of computing buys, on held-out patients of the first fold; not part of `all`.

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


# Timed, so each of these jobs has the machine for itself.
rule measure_fem:
    input:
        models=[sized(nodes, "model.h5") for nodes in SIZES],
        plan="<results>/cases/{case}/plan.json",
        postop="<results>/cases/{case}/postop.h5",
    output:
        rows="<results>/tradeoff/{case}/fem.csv",
        reference="<results>/tradeoff/{case}/reference.h5",
    log:
        "<logs>/measure_fem/{case}.log",
    benchmark:
        "<benchmarks>/measure_fem/{case}.tsv"
    conda:
        "../envs/pinnochio.yaml"
    threads: workflow.cores
    resources:
        mem_mb=8000,
        runtime=60,
    params:
        sizes=SIZES,
        nodes=config["mesh"]["nodes"],
        tradeoff=TRADEOFF,
        fem=config["fem"],
        samples=config["evaluation"]["samples"],
        seed=SEED,
        code=code_of("anatomy", "mechanics", "evaluation", "tradeoff"),
    message:
        "Solve {wildcards.case} along the dials of finite elements"
    script:
        "../scripts/measure_fem.py"


rule measure_networks:
    input:
        networks=expand(
            "<results>/folds/{fold}/{method}/network.pt",
            fold=FIRST,
            method=TRADED_NETWORKS,
        ),
        models=[sized(nodes, "model.h5") for nodes in SIZES],
        lifts=[sized(nodes, f"lift_{kind}.h5") for kind, nodes in LIFTS],
        plan="<results>/cases/{case}/plan.json",
        postop="<results>/cases/{case}/postop.h5",
        reference="<results>/tradeoff/{case}/reference.h5",
    output:
        rows="<results>/tradeoff/{case}/networks.csv",
    log:
        "<logs>/measure_networks/{case}.log",
    benchmark:
        "<benchmarks>/measure_networks/{case}.tsv"
    conda:
        "../envs/pinnochio.yaml"
    threads: workflow.cores
    resources:
        mem_mb=8000,
        runtime=60,
        gpu=1,
    params:
        methods=TRADED_NETWORKS,
        variants={
            name: VARIANTS[name] for name in [*TRADEOFF["networks"], *TRADED_NETWORKS]
        },
        lifts=LIFTS,
        sizes=SIZES,
        nodes=config["mesh"]["nodes"],
        tradeoff=TRADEOFF,
        fem=config["fem"],
        samples=config["evaluation"]["samples"],
        seed=SEED,
        code=code_of(
            "anatomy", "mechanics", "networks", "training", "evaluation", "tradeoff"
        ),
    message:
        "Predict {wildcards.case} along the dials of the networks"
    script:
        "../scripts/measure_networks.py"


rule measure_study:
    input:
        predictions=expand(
            "<results>/folds/{fold}/{method}/predictions.h5",
            fold=FIRST,
            method=AS_THEY_ARE,
        ),
        models=lambda wildcards: [
            path for method in AS_THEY_ARE for path in model_of(wildcards.case, method)
        ],
        postop="<results>/cases/{case}/postop.h5",
        reference="<results>/tradeoff/{case}/reference.h5",
        reference_model=sized(TRADEOFF["reference"], "model.h5"),
    output:
        rows="<results>/tradeoff/{case}/study.csv",
    log:
        "<logs>/measure_study/{case}.log",
    benchmark:
        "<benchmarks>/measure_study/{case}.tsv"
    conda:
        "../envs/pinnochio.yaml"
    threads: 1
    resources:
        mem_mb=4000,
        runtime=20,
    params:
        methods=AS_THEY_ARE,
        fem=config["fem"],
        samples=config["evaluation"]["samples"],
        seed=SEED,
        code=code_of("anatomy", "mechanics", "evaluation", "tradeoff"),
    message:
        "Judge the study's other predictions of {wildcards.case}"
    script:
        "../scripts/measure_study.py"


rule collect_tradeoff:
    input:
        rows=rows_of_traded,
    output:
        table=ensure("<results>/tables/tradeoff.csv", non_empty=True),
        markdown="<results>/tables/tradeoff.md",
        latex="<results>/tables/tradeoff.tex",
        html="<results>/tables/tradeoff.html",
        cases=ensure("<results>/tables/tradeoff_cases.csv", non_empty=True),
        choices=ensure("<results>/tables/choices.csv", non_empty=True),
    log:
        "<logs>/collect_tradeoff.log",
    conda:
        "../envs/pinnochio.yaml"
    threads: 1
    resources:
        mem_mb=1000,
        runtime=5,
    params:
        budgets=TRADEOFF["budgets"],
        tolerances=TRADEOFF["allowed"],
        cohort=COHORT,
        code=code_of("evaluation", "tradeoff"),
    message:
        "Find the front of seconds and accuracy"
    script:
        "../scripts/collect_tradeoff.py"


rule render_tradeoff:
    input:
        table="<results>/tables/tradeoff.csv",
    output:
        pictures=expand("<results>/figures/tradeoff.{kind}", kind=["png", "svg"]),
    log:
        "<logs>/render_tradeoff.log",
    conda:
        "../envs/pinnochio.yaml"
    threads: 1
    resources:
        mem_mb=1000,
        runtime=5,
    params:
        code=code_of("evaluation", "tradeoff"),
    message:
        "Draw the trade-off"
    script:
        "../scripts/render_tradeoff.py"


rule tradeoff:
    input:
        rules.collect_tradeoff.output,
        rules.render_tradeoff.output,
    message:
        "Seconds against accuracy: see {config[pathvars][results]}/tables/tradeoff.md"
