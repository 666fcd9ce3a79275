# The dial between a network and finite elements on its interface; not part of `all`.


# Timed, so each of these jobs has the machine for itself.
rule refine:
    input:
        predictions="<results>/folds/{fold}/{method}/predictions.h5",
        models=of_held_out("<results>/cases/{case}/model.h5"),
    output:
        refined=expand(
            "<results>/folds/{fold}/{method}/refined_{corrections}.h5",
            corrections=config["dial"]["corrections"],
            allow_missing=True,
        ),
    log:
        "<logs>/refine/{fold}_{method}.log",
    benchmark:
        "<benchmarks>/refine/{fold}_{method}.tsv"
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
        corrections=config["dial"]["corrections"],
        fem=config["fem"],
        code=code_of("refine"),
    message:
        "Correct {wildcards.method} on fold {wildcards.fold}"
    script:
        "../scripts/refine.py"


use rule evaluate as evaluate_refined with:
    input:
        predictions="<results>/folds/{fold}/{method}/refined_{corrections}.h5",
        models=of_held_out("<results>/cases/{case}/model.h5"),
        plans=of_held_out("<results>/cases/{case}/plan.json"),
        postops=of_scanned("<results>/cases/{case}/postop.h5"),
        truths=of_held_out("<results>/virtual/{case}/truth.h5") if VIRTUAL else [],
    output:
        metrics=ensure(
            "<results>/folds/{fold}/{method}/refined_{corrections}.csv", non_empty=True
        ),
    log:
        "<logs>/evaluate_refined/{fold}_{method}_{corrections}.log",
    benchmark:
        "<benchmarks>/evaluate_refined/{fold}_{method}_{corrections}.tsv"
    wildcard_constraints:
        corrections=r"\d+",
    message:
        "Measure {wildcards.method} after {wildcards.corrections} corrections on fold {wildcards.fold}"


rule collect_dial:
    input:
        metrics=[
            f"<results>/folds/{fold}/{method}/{name}.csv"
            for method in DIAL
            for name in [
                "metrics",
                *(f"refined_{count}" for count in config["dial"]["corrections"]),
            ]
            for fold in HELD_OUT
        ],
    output:
        table=ensure("<results>/tables/dial.csv", non_empty=True),
        markdown="<results>/tables/dial.md",
        latex="<results>/tables/dial.tex",
        html=captioned("<results>/tables/dial.html"),
    log:
        "<logs>/collect_dial.log",
    conda:
        "../envs/pinnochio.yaml"
    threads: 1
    resources:
        mem_mb=1000,
        runtime=5,
    params:
        methods=DIAL,
        corrections=[0, *config["dial"]["corrections"]],
        folds=len(HELD_OUT),
        cohort=COHORT,
        seed=SEED,
        code=code_of("collect_dial"),
    message:
        "Compare the predictions with their corrected fields"
    script:
        "../scripts/collect_dial.py"


rule render_dial:
    input:
        table="<results>/tables/dial.csv",
    output:
        picture=captioned("<results>/figures/dial.png"),
    log:
        "<logs>/render_dial.log",
    conda:
        "../envs/pinnochio.yaml"
    threads: 1
    resources:
        mem_mb=1000,
        runtime=5,
    params:
        code=code_of("render_dial"),
    message:
        "Draw the dial"
    script:
        "../scripts/render_dial.py"


rule dial:
    input:
        rules.collect_dial.output,
        rules.render_dial.output,
    message:
        "The dial is measured"
