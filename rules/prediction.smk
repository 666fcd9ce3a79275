# One core each, so that their seconds compare; undisturbed ones are those of the trade-off.
rule predict_cases:
    input:
        trained=trained,
        models=models_of_held_out,
        lifts=lifts_of(held_out),
        plans=of_held_out("<results>/cases/{case}/plan.json"),
    output:
        predictions="<results>/folds/{fold}/{method}/predictions.h5",
    log:
        "<logs>/predict/{fold}_{method}.log",
    benchmark:
        "<benchmarks>/predict/{fold}_{method}.tsv"
    wildcard_constraints:
        method="|".join(MODULES),
    conda:
        "../envs/pinnochio.yaml"
    threads: 1
    resources:
        mem_mb=4000,
        runtime=60,
        gpu=lambda wildcards: GPU if wildcards.method in SETTINGS else 0,
    params:
        cases=held_out,
        module=module_of("predictor"),
        settings=settings_of("fem", "newton_corrections", "contact", "apart"),
        code=code_with_method("predict", "predictor"),
    message:
        "Predict fold {wildcards.fold} by {wildcards.method}"
    script:
        "../scripts/predict.py"


# Made by others with the files of `inputs`; the timings in the files are their authors'.
rule predict_external:
    input:
        files=external_files,
        meshes=of_held_out("<results>/cases/{case}/mesh.vtu"),
    output:
        predictions="<results>/folds/{fold}/{method}/predictions.h5",
    log:
        "<logs>/predict_external/{fold}_{method}.log",
    wildcard_constraints:
        method="|".join(EXTERNAL) or "none",
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
            fold=HELD_OUT,
            method=METHODS,
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
        held_out=HELD_OUT,
        scanned=SCANNED,
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
            case=CASES,
            file=["mesh.vtu", "model.h5", "plan.json"],
        ),
        expand("<results>/cases/{case}/postop.h5", case=SCANNED),
        "<results>/folds.csv",
    message:
        "Everything is there that a method may read"
