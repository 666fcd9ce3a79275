# What a second of computing buys, on held-out patients; not part of `all`.

from studies.tradeoff.inputs import Tradeoff

check_networks("tradeoff.networks", config["tradeoff"]["networks"])
TRADED = Tradeoff(
    config=config,
    judged=[case for fold in STUDY.folds.held_out for case in STUDY.folds.judged(fold)],
    registry=STUDY.methods.registry,
    variants=NETWORKS,
)
add_table(
    "tradeoff_cases",
    "studies.tradeoff.cases",
    caption="Every setting of the trade-off on every patient.",
    files=TRADED.rows,
    arguments=NAMED,
)
add_table(
    "tradeoff",
    "studies.tradeoff.table",
    title="Seconds against accuracy",
    caption="What a second of computing buys: methods with one setting changed at a time, on held-out patients of the first fold, and against the outcome as in the study.",
    figure="studies.tradeoff.figure",
    files={
        "cases": "<results>/tables/tradeoff_cases.csv",
        "judged": JUDGED["cases"],
    },
    arguments=NAMED,
)


# Timed, so each of these jobs has the machine for itself.
rule measure_fem:
    input:
        models=[STUDY.sized(nodes, "model.h5") for nodes in TRADED.sizes],
        plan=INPUTS.patient.motion,
    output:
        rows="<results>/tradeoff/{case}/fem.csv",
        reference="<results>/tradeoff/{case}/reference.h5",
    log:
        "<logs>/measure_fem/{case}.log",
    benchmark:
        "<benchmarks>/measure_fem/{case}.tsv"
    conda:
        "../../../envs/pinnochio.yaml"
    threads: ALL_CORES
    resources:
        mem_mb=8000,
        runtime=60,
    params:
        settings=[vars(setting) for setting in TRADED.fem_settings],
        sizes=TRADED.sizes,
        nodes=config["mesh"]["nodes"],
        fem=config["fem"],
        code=code_of("studies.tradeoff.measure_fem"),
    message:
        "Solve {wildcards.case} along the parameters of finite elements"
    script:
        "measure_fem.py"


rule measure_networks:
    input:
        networks=lambda wildcards: expand(
            "<results>/folds/{fold}/{method}/network.pt",
            fold=STUDY.folds.by_case[wildcards.case],
            method=TRADED.networks,
        ),
        models=[STUDY.sized(nodes, "model.h5") for nodes in TRADED.sizes],
        lifts=[STUDY.sized(nodes, f"lift_{kind}.h5") for kind, nodes in TRADED.lifts],
        plan=INPUTS.patient.motion,
        reference="<results>/tradeoff/{case}/reference.h5",
    output:
        rows="<results>/tradeoff/{case}/networks.csv",
    log:
        "<logs>/measure_networks/{case}.log",
    benchmark:
        "<benchmarks>/measure_networks/{case}.tsv"
    conda:
        "../../../envs/pinnochio.yaml"
    threads: ALL_CORES
    resources:
        mem_mb=8000,
        runtime=60,
        gpu=GPU,
    params:
        methods=TRADED.networks,
        settings=[vars(setting) for setting in TRADED.network_settings],
        kinds={
            method: STUDY.methods.registry[method].lift for method in TRADED.networks
        },
        lifts=TRADED.lifts,
        sizes=TRADED.sizes,
        reference_nodes=config["tradeoff"]["reference"],
        fem=config["fem"],
        code=code_of("studies.tradeoff.measure_networks"),
    message:
        "Predict {wildcards.case} along the parameters of the networks"
    script:
        "measure_networks.py"


rule tradeoff:
    input:
        recorded("tradeoff"),
        expand("<results>/figures/tradeoff.{kind}", kind=["png", "svg"]),
    message:
        "Seconds against accuracy: see {config[pathvars][results]}/tables/tradeoff.md"
