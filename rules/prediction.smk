# Predictions are timed, so each of these jobs has the machine for itself: it claims every core.


rule predict_no_change:
    input:
        models=of_held_out("<results>/cases/{case}/model.h5"),
    output:
        predictions="<results>/folds/{fold}/no_change/predictions.h5",
    log:
        "<logs>/predict_no_change/{fold}.log",
    conda:
        "../envs/pinnochio.yaml"
    threads: 1
    resources:
        mem_mb=1000,
        runtime=5,
    params:
        cases=held_out,
        code=code_of("anatomy"),
    message:
        "Predict fold {wildcards.fold} with no change at all"
    script:
        "../scripts/predict_no_change.py"


rule predict_fem:
    input:
        models=of_held_out("<results>/cases/{case}/model.h5"),
        plans=of_held_out("<results>/cases/{case}/plan.json"),
    output:
        predictions="<results>/folds/{fold}/{method}/predictions.h5",
    log:
        "<logs>/predict_fem/{fold}_{method}.log",
    benchmark:
        "<benchmarks>/predict_fem/{fold}_{method}.tsv"
    wildcard_constraints:
        method="|".join(ARMS),
    conda:
        "../envs/pinnochio.yaml"
    threads: workflow.cores
    resources:
        mem_mb=4000,
        runtime=60,
    params:
        cases=held_out,
        arm=lambda wildcards: ARMS[wildcards.method],
        fem=config["fem"],
        code=code_of("anatomy", "mechanics"),
    message:
        "Predict fold {wildcards.fold} by {wildcards.method}"
    script:
        "../scripts/predict_fem.py"


rule predict_network:
    input:
        network="<results>/folds/{fold}/{method}/network.pt",
        models=of_held_out("<results>/cases/{case}/model.h5"),
        plans=of_held_out("<results>/cases/{case}/plan.json"),
    output:
        predictions="<results>/folds/{fold}/{method}/predictions.h5",
    log:
        "<logs>/predict_network/{fold}_{method}.log",
    benchmark:
        "<benchmarks>/predict_network/{fold}_{method}.tsv"
    wildcard_constraints:
        method="|".join(LEARNED) or "none",
    conda:
        "../envs/pinnochio.yaml"
    threads: workflow.cores
    resources:
        mem_mb=4000,
        runtime=20,
        gpu=1,
    params:
        cases=held_out,
        fem=config["fem"],
        code=code_of("anatomy", "mechanics", "networks", "training"),
    message:
        "Predict fold {wildcards.fold} by {wildcards.method}"
    script:
        "../scripts/predict_network.py"


rule predictions:
    input:
        expand(
            "<results>/folds/{fold}/{method}/predictions.h5",
            fold=HELD_OUT,
            method=config["methods"],
        ),
    message:
        "Every held-out patient is predicted by every method"
