# From a network's field to finite elements on its interface, correction by correction; not part of `all`.


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
            "<results>/folds/{fold}/{method}/corrected_{corrections}.csv",
            non_empty=True,
        ),
    log:
        "<logs>/evaluate_corrected/{fold}_{method}_{corrections}.log",
    benchmark:
        "<benchmarks>/evaluate_corrected/{fold}_{method}_{corrections}.tsv"
    wildcard_constraints:
        corrections=r"\d+",
    message:
        "Measure {wildcards.method} after {wildcards.corrections} corrections on fold {wildcards.fold}"


rule corrections:
    input:
        table_and_twins("corrections"),
        "<results>/figures/corrections.png",
    message:
        "The corrections are measured"
