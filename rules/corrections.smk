# The dial between a network and finite elements on its interface; not part of `all`.


# Timed, so each of these jobs has the machine for itself.
rule correct:
    input:
        predictions="<results>/folds/{fold}/{method}/predictions.h5",
        models=of_held_out("<results>/cases/{case}/model.h5"),
    output:
        corrected=expand(
            "<results>/folds/{fold}/{method}/corrected_{corrections}.h5",
            corrections=config["corrections"]["counts"],
            allow_missing=True,
        ),
    log:
        "<logs>/correct/{fold}_{method}.log",
    benchmark:
        "<benchmarks>/correct/{fold}_{method}.tsv"
    wildcard_constraints:
        method="|".join(VARIANTS) or "none",
    conda:
        "../envs/pinnochio.yaml"
    threads: workflow.cores
    resources:
        mem_mb=4000,
        runtime=60,
    params:
        cases=held_out,
        corrections=config["corrections"]["counts"],
        fem=config["fem"],
        code=code_of("correct"),
    message:
        "Correct {wildcards.method} on fold {wildcards.fold}"
    script:
        "../scripts/correct.py"


use rule evaluate as evaluate_corrected with:
    input:
        predictions="<results>/folds/{fold}/{method}/corrected_{corrections}.h5",
        models=of_held_out("<results>/cases/{case}/model.h5"),
        plans=of_held_out("<results>/cases/{case}/plan.json"),
        postops=of_scanned("<results>/cases/{case}/postop.h5"),
        truths=of_held_out("<results>/virtual/{case}/truth.h5") if VIRTUAL else [],
    output:
        metrics=ensure(
            "<results>/folds/{fold}/{method}/corrected_{corrections}.csv", non_empty=True
        ),
    log:
        "<logs>/evaluate_corrected/{fold}_{method}_{corrections}.log",
    benchmark:
        "<benchmarks>/evaluate_corrected/{fold}_{method}_{corrections}.tsv"
    wildcard_constraints:
        corrections=r"\d+",
    message:
        "Measure {wildcards.method} after {wildcards.corrections} corrections on fold {wildcards.fold}"


rule tabulate_corrections:
    input:
        metrics=[
            f"<results>/folds/{fold}/{method}/{name}.csv"
            for method in CORRECTIONS
            for name in [
                "metrics",
                *(f"corrected_{count}" for count in config["corrections"]["counts"]),
            ]
            for fold in HELD_OUT
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
        methods=CORRECTIONS,
        corrections=[0, *config["corrections"]["counts"]],
        folds=len(HELD_OUT),
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
        "Draw the dial"
    script:
        "../scripts/render_corrections.py"


rule corrections:
    input:
        rules.tabulate_corrections.output,
        rules.render_corrections.output,
    message:
        "The dial is measured"
