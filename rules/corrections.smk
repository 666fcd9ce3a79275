# Newton corrections between a network's field and equilibrium on its interface; not part of `all`.


# Timed, so each of these jobs has the machine for itself.
rule correct:
    input:
        predictions="<results>/folds/{fold}/{method}/predictions.h5",
        models=STUDY.of_held_out("<results>/cases/{case}/model.h5"),
    output:
        corrected=expand(
            "<results>/folds/{fold}/{method}/corrected_{corrections}/predictions.h5",
            corrections=config["corrections"]["counts"],
            allow_missing=True,
        ),
    log:
        "<logs>/correct/{fold}_{method}.log",
    benchmark:
        "<benchmarks>/correct/{fold}_{method}.tsv"
    wildcard_constraints:
        method=any_of(NETWORKS),
    conda:
        "../envs/pinnochio.yaml"
    threads: ALL_CORES
    resources:
        mem_mb=4000,
        runtime=60,
    params:
        cases=STUDY.held_out_cases,
        corrections=config["corrections"]["counts"],
        fem=config["fem"],
        code=code_of("correct"),
    message:
        "Correct {wildcards.method} on fold {wildcards.fold}"
    script:
        "../scripts/correct.py"


rule tabulate_corrections:
    input:
        metrics=[
            f"<results>/folds/{fold}/{method}{corrected}/metrics.csv"
            for method in STUDY.asked("corrections")
            for corrected in [
                "",
                *(f"/corrected_{count}" for count in config["corrections"]["counts"]),
            ]
            for fold in STUDY.held_out
        ],
    output:
        table=ensure("<results>/tables/corrections.csv", non_empty=True),
        markdown="<results>/tables/corrections.md",
        latex="<results>/tables/corrections.tex",
        html=captioned("<results>/tables/corrections.html"),
    log:
        "<logs>/tabulate_corrections.log",
    conda:
        "../envs/pinnochio.yaml"
    threads: 1
    resources:
        mem_mb=1000,
        runtime=5,
    params:
        methods=STUDY.asked("corrections"),
        corrections=[0, *config["corrections"]["counts"]],
        folds=len(STUDY.held_out),
        cohort=COHORT,
        seed=SEED,
        code=code_of("tabulate_corrections"),
    message:
        "Compare the predictions with their corrected fields"
    script:
        "../scripts/tabulate_corrections.py"


rule render_corrections:
    input:
        table="<results>/tables/corrections.csv",
    output:
        picture=captioned("<results>/figures/corrections.png"),
    log:
        "<logs>/render_corrections.log",
    conda:
        "../envs/pinnochio.yaml"
    threads: 1
    resources:
        mem_mb=1000,
        runtime=5,
    params:
        code=code_of("render_corrections"),
    message:
        "Draw what the corrections buy"
    script:
        "../scripts/render_corrections.py"


rule corrections:
    input:
        rules.tabulate_corrections.output,
        rules.render_corrections.output,
    message:
        "The corrections are measured"
