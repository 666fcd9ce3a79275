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
        "../../../envs/pinnochio.yaml"
    threads: ALL_CORES
    resources:
        mem_mb=4000,
        runtime=60,
    params:
        cases=STUDY.held_out_cases,
        corrections=config["corrections"]["counts"],
        fem=config["fem"],
        code=code_of("studies.corrections.correct"),
    message:
        "Correct {wildcards.method} on fold {wildcards.fold}"
    script:
        "correct.py"


rule corrections:
    input:
        recorded("corrections"),
        "<results>/figures/corrections.png",
    message:
        "The corrections are measured"
