# One core each, so that their seconds compare; undisturbed ones are those of the trade-off.
rule predict_cases:
    input:
        trained=STUDY.of_batch("trained"),
        models=STUDY.of_batch("models"),
        lifts=STUDY.of_batch("lifts"),
        covariates=STUDY.of_batch("covariates"),
        plans=STUDY.of_batch("plans"),
        truths=STUDY.of_batch("truths"),
    output:
        predictions="<results>/{batch}/{method}/predictions.h5",
    log:
        "<logs>/predict/{batch}_{method}.log",
    benchmark:
        "<benchmarks>/predict/{batch}_{method}.tsv"
    wildcard_constraints:
        method=any_of(STUDY.predicting),
    conda:
        "../envs/pinnochio.yaml"
    threads: 1
    resources:
        mem_mb=4000,
        runtime=60,
        gpu=lambda wildcards: (
            GPU if wildcards.method in STUDY.trained("by steps") else 0
        ),
    params:
        cases=STUDY.of_batch("cases"),
        predictor=STUDY.predictor,
        settings=STUDY.of_batch("settings"),
        code=code_with_method("predict"),
    message:
        "Predict {wildcards.batch} by {wildcards.method}"
    script:
        "../scripts/predict.py"


# Made by others with the files of `inputs`; the timings in the files are their authors'.
rule predict_external:
    input:
        files=STUDY.external_files,
        meshes=STUDY.of_held_out("<results>/cases/{case}/mesh.vtu"),
    output:
        predictions="<results>/folds/{fold}/{method}/predictions.h5",
    log:
        "<logs>/predict_external/{fold}_{method}.log",
    wildcard_constraints:
        method=any_of(config["external"]),
    conda:
        "../envs/pinnochio.yaml"
    threads: 1
    resources:
        mem_mb=1000,
        runtime=5,
    params:
        cases=STUDY.held_out_cases,
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
        expand("<results>/cases/{case}/achieved.json", case=STUDY.registered),
        expand("<results>/cases/{case}/covariates.json", case=STUDY.described),
        "<results>/folds.csv",
    message:
        "Everything is there that a method may read"
