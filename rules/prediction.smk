# One core each, so that their seconds compare; undisturbed ones are those of the trade-off.


rule predict_no_change:
    input:
        models=STUDY.of_held_out("<results>/cases/{case}/model.h5"),
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
        code=code_of("predict_no_change"),
    message:
        "Predict fold {wildcards.fold} with no change at all"
    script:
        "../scripts/predict_no_change.py"


rule predict_fem:
    input:
        models=models_of_held_out,
        plans=STUDY.of_held_out("<results>/cases/{case}/plan.json"),
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
    threads: 1
    resources:
        mem_mb=4000,
        runtime=60,
    params:
        cases=held_out,
        arm=lambda wildcards: ARMS[wildcards.method],
        fem=fem_of,
        apart=lambda wildcards: (
            config["fem_rlse"]["apart"] if wildcards.method in ON_LIPS else 0
        ),
        code=code_of("predict_fem"),
    message:
        "Predict fold {wildcards.fold} by {wildcards.method}"
    script:
        "../scripts/predict_fem.py"


rule predict_network:
    input:
        network="<results>/folds/{fold}/{method}/network.pt",
        models=STUDY.of_held_out("<results>/cases/{case}/model.h5"),
        lifts=lifts_of(held_out),
        plans=STUDY.of_held_out("<results>/cases/{case}/plan.json"),
    output:
        predictions="<results>/folds/{fold}/{method}/predictions.h5",
    log:
        "<logs>/predict_network/{fold}_{method}.log",
    benchmark:
        "<benchmarks>/predict_network/{fold}_{method}.tsv"
    wildcard_constraints:
        method=any_of(NETWORKS),
    conda:
        "../envs/pinnochio.yaml"
    threads: 1
    resources:
        mem_mb=4000,
        runtime=20,
        gpu=GPU,
    params:
        cases=held_out,
        fem=config["fem"],
        corrections=settings_of("newton_corrections"),
        code=code_of("predict_network"),
    message:
        "Predict fold {wildcards.fold} by {wildcards.method}"
    script:
        "../scripts/predict_network.py"


# Made by others with the files of `inputs`; the timings in the files are their authors'.
rule predict_external:
    input:
        files=external_files,
        meshes=STUDY.of_held_out("<results>/cases/{case}/mesh.vtu"),
    output:
        predictions="<results>/folds/{fold}/{method}/predictions.h5",
    log:
        "<logs>/predict_external/{fold}_{method}.log",
    wildcard_constraints:
        method=any_of(EXTERNAL),
    conda:
        "../envs/pinnochio.yaml"
    threads: 1
    resources:
        mem_mb=1000,
        runtime=5,
    params:
        cases=held_out,
        code=code_of("predict_external"),
    message:
        "Read what {wildcards.method} predicts for fold {wildcards.fold}"
    script:
        "../scripts/predict_external.py"


rule predictions:
    input:
        expand(
            "<results>/folds/{fold}/{method}/predictions.h5",
            fold=STUDY.held_out,
            method=STUDY.methods,
        ),
    message:
        "Every held-out patient is predicted by every method"


rule list_folds:
    output:
        table=ensure("<results>/folds.csv", non_empty=True),
    log:
        "<logs>/list_folds.log",
    conda:
        "../envs/pinnochio.yaml"
    threads: 1
    resources:
        mem_mb=500,
        runtime=5,
    params:
        held_out=STUDY.held_out,
        scanned=STUDY.scanned,
        code=code_of("list_folds"),
    message:
        "List the fold that holds each patient out"
    script:
        "../scripts/list_folds.py"


# What a method made elsewhere may read; the truth of the virtual cohort is not among it.
rule inputs:
    input:
        expand(
            "<results>/cases/{case}/{file}",
            case=STUDY.cases,
            file=["mesh.vtu", "model.h5", "plan.json"],
        ),
        expand("<results>/cases/{case}/postop.h5", case=STUDY.scanned),
        "<results>/folds.csv",
    message:
        "Everything is there that a method may read"
