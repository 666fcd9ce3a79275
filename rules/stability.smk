# What the mechanics does at the extremes; a cell that is wrong fails the job, which says which.
rule measure_stability:
    input:
        model=f"<results>/cases/{next(iter(STUDY.cases))}/model.h5",
    output:
        table=ensure("<results>/tables/stability.csv", non_empty=True),
        markdown="<results>/tables/stability.md",
        latex="<results>/tables/stability.tex",
        html=captioned("<results>/tables/stability.html"),
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


rule render_stability:
    input:
        table="<results>/tables/stability.csv",
    output:
        picture=captioned("<results>/figures/stability.png"),
    log:
        "<logs>/render_stability.log",
    conda:
        "../envs/pinnochio.yaml"
    threads: 1
    resources:
        mem_mb=1000,
        runtime=5,
    params:
        code=code_of("render_stability"),
    message:
        "Draw the stability sweep"
    script:
        "../scripts/render_stability.py"


rule stability:
    input:
        rules.measure_stability.output,
        rules.render_stability.output,
    message:
        "The extremes are measured"
