# What a second of computing buys, on held-out patients; not part of `all`.


# Timed, so each of these jobs has the machine for itself.
rule measure_fem:
    input:
        models=[STUDY.sized(nodes, "model.h5") for nodes in STUDY.sizes],
        plan=STUDY.motion,
        postop="<results>/cases/{case}/postop.h5",
        judged="<results>/cases/{case}/judged.h5",
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
        settings=[vars(setting) for setting in STUDY.fem_settings],
        sizes=STUDY.sizes,
        nodes=config["mesh"]["nodes"],
        fem=config["fem"],
        code=code_of("studies.tradeoff.measure_fem"),
    message:
        "Solve {wildcards.case} along the parameters of finite elements"
    script:
        "measure_fem.py"


rule measure_networks:
    input:
        networks=STUDY.of_own_fold("network.pt", STUDY.traded_networks),
        models=[STUDY.sized(nodes, "model.h5") for nodes in STUDY.sizes],
        lifts=[
            STUDY.sized(nodes, f"lift_{kind}.h5") for kind, nodes in STUDY.traded_lifts
        ],
        plan=STUDY.motion,
        postop="<results>/cases/{case}/postop.h5",
        judged="<results>/cases/{case}/judged.h5",
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
        methods=STUDY.traded_networks,
        settings=[vars(setting) for setting in STUDY.network_settings],
        kinds={method: STUDY.registry[method].lift for method in STUDY.traded_networks},
        lifts=STUDY.traded_lifts,
        sizes=STUDY.sizes,
        reference_nodes=config["tradeoff"]["reference"],
        fem=config["fem"],
        code=code_of("studies.tradeoff.measure_networks"),
    message:
        "Predict {wildcards.case} along the parameters of the networks"
    script:
        "measure_networks.py"


rule measure_study:
    input:
        predictions=STUDY.of_own_fold("predictions.h5", STUDY.judged_as_they_are),
        models=lambda wildcards: [
            STUDY.model_of(wildcards.case, method)
            for method in STUDY.judged_as_they_are
        ],
        postop="<results>/cases/{case}/postop.h5",
        judged="<results>/cases/{case}/judged.h5",
        reference="<results>/tradeoff/{case}/reference.h5",
        reference_model=STUDY.sized(config["tradeoff"]["reference"], "model.h5"),
    output:
        rows="<results>/tradeoff/{case}/study.csv",
    log:
        "<logs>/measure_study/{case}.log",
    benchmark:
        "<benchmarks>/measure_study/{case}.tsv"
    conda:
        "../../../envs/pinnochio.yaml"
    resources:
        mem_mb=4000,
        runtime=20,
    params:
        methods=STUDY.judged_as_they_are,
        fem=config["fem"],
        code=code_of("studies.tradeoff.measure_study"),
    message:
        "Judge the study's other predictions of {wildcards.case}"
    script:
        "measure_study.py"


rule tradeoff:
    input:
        recorded("tradeoff"),
        expand("<results>/figures/tradeoff.{kind}", kind=["png", "svg"]),
    message:
        "Seconds against accuracy: see {config[pathvars][results]}/tables/tradeoff.md"
