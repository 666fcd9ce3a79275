# What the mechanics does at the extremes; a cell that is wrong fails the job, which says which.
rule measure_stability:
    input:
        model=f"<results>/cases/{next(iter(STUDY.cases))}/model.h5",
    output:
        table=ensure("<results>/tables/stability.csv", non_empty=True),
        document="<results>/tables/stability.json",
    log:
        "<logs>/measure_stability.log",
    benchmark:
        "<benchmarks>/measure_stability.tsv"
    conda:
        "../envs/pinnochio.yaml"
    threads: 1
    resources:
        mem_mb=4000,
        runtime=60,
    params:
        case=next(iter(STUDY.cases)),
        stability=config["stability"],
        fem=config["fem"],
        seed=SEED,
        code=code_of("stability"),
    message:
        "Take solver, elastic path and physics loss to their extremes"
    script:
        "../scripts/stability.py"


rule stability:
    input:
        table_and_twins("stability"),
        "<results>/figures/stability.png",
    message:
        "The extremes are measured"
