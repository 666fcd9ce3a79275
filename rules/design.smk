# What each switch of the better network is worth, on the first folds; not part of `all`.


rule compare_designs:
    input:
        metrics=expand(
            "<results>/folds/{fold}/{method}/metrics.csv",
            fold=list(STUDY.held_out)[: config["design"]["folds"]],
            method=STUDY.design,
        ),
    output:
        table=ensure("<results>/tables/design.csv", non_empty=True),
        markdown="<results>/tables/design.md",
        latex="<results>/tables/design.tex",
        html=captioned("<results>/tables/design.html"),
    log:
        "<logs>/compare_designs.log",
    conda:
        "../envs/pinnochio.yaml"
    threads: 1
    resources:
        mem_mb=1000,
        runtime=5,
    params:
        variants={name: NETWORKS[name] for name in STUDY.design},
        cohort=COHORT,
        seed=SEED,
        code=code_of("compare_designs"),
    message:
        "Compare the switches of {config[design][base]}"
    script:
        "../scripts/compare_designs.py"


rule design:
    input:
        rules.compare_designs.output,
    message:
        "The design study is done"
