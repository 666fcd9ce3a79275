# What trainings and predictions read of the patients that a fold holds out: a folder per kind of file.
rule gather:
    input:
        INPUTS.gathered.files,
    output:
        folder=directory("<results>/held_out/{fold}/{kind}"),
    log:
        "<logs>/gather/{fold}_{kind}.log",
    wildcard_constraints:
        fold=any_of(STUDY.folds.held_out),
        kind="[a-z]+",
    conda:
        "../envs/pinnochio.yaml"
    resources:
        mem_mb=500,
        runtime=10,
    params:
        names=INPUTS.gathered.names,
        code=code_of("scripts.prediction.gather"),
    message:
        "Gather files of fold {wildcards.fold}: {wildcards.kind}"
    script:
        "../scripts/prediction/gather.py"


# Predicts and judges. One core each, so that their seconds compare; undisturbed ones are those of the trade-off.
rule predict_cases:
    input:
        unpack(INPUTS.prediction.gathered),
    output:
        predictions=update("<results>/{batch}/{method}/predictions.h5"),
        metrics=ensure(update("<results>/{batch}/{method}/metrics.csv"), non_empty=True),
        skins=update("<results>/{batch}/{method}/skins.h5"),
    log:
        "<logs>/predict/{batch}_{method}.log",
    benchmark:
        "<benchmarks>/predict/{batch}_{method}.tsv"
    wildcard_constraints:
        method=any_of(STUDY.methods.predicting),
    conda:
        "../envs/pinnochio.yaml"
    resources:
        mem_mb=megabytes(4000),
        runtime=60,
        gpu=lambda wildcards: (
            GPU if wildcards.method in STUDY.methods.trained("by steps") else 0
        ),
    params:
        cases=INPUTS.prediction.of_batch("cases"),
        scanned=INPUTS.prediction.of_batch("scanned"),
        predictor=INPUTS.prediction.predictor,
        settings=INPUTS.prediction.of_batch("settings"),
        fem=config["fem"],
        seed=SEED,
        code=code_with_method("scripts.prediction.predict_cases"),
    message:
        "Predict {wildcards.batch} by {wildcards.method}, and judge it"
    script:
        "../scripts/prediction/predict_cases.py"


# The same patients from their plans too, in one job.
use rule predict_cases as predict_both_motions with:
    input:
        unpack(INPUTS.prediction.gathered),
    output:
        **{
            f"{arm}_{name.partition('.')[0]}": update(
                f"<results>/{arm}/{{fold}}/{{method}}/{name}"
            )
            for arm in ("folds", "planned")
            for name in ("predictions.h5", "metrics.csv", "skins.h5")
        },
    log:
        "<logs>/predict/both/{fold}_{method}.log",
    benchmark:
        "<benchmarks>/predict/both/{fold}_{method}.tsv"
    wildcard_constraints:
        fold=any_of(STUDY.folds.held_out),
        method=any_of(STUDY.planned),
    message:
        "Predict fold {wildcards.fold} by {wildcards.method} from both motions, and judge it"


# What is predicted here is judged at once.
ruleorder: predict_both_motions > predict_cases > evaluate


# Made by others with the files of `inputs`; the timings in the files are their authors'.
rule predict_external:
    input:
        files=INPUTS.prediction.external_files,
        meshes=INPUTS.prediction.of_held_out("<results>/cases/{case}/mesh.vtu"),
    output:
        predictions="<results>/folds/{fold}/{method}/predictions.h5",
    log:
        "<logs>/predict_external/{fold}_{method}.log",
    wildcard_constraints:
        method=any_of(config["external"]),
    conda:
        "../envs/pinnochio.yaml"
    resources:
        mem_mb=1000,
        runtime=5,
    params:
        cases=INPUTS.prediction.held_out,
        content=content(INPUTS.prediction.external_files),
        code=code_of("scripts.prediction.predict_external"),
    message:
        "Read what {wildcards.method} predicts for fold {wildcards.fold}"
    script:
        "../scripts/prediction/predict_external.py"


rule predictions:
    input:
        expand(
            "<results>/folds/{fold}/{method}/predictions.h5",
            fold=STUDY.folds.held_out,
            method=STUDY.methods.used,
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
    resources:
        mem_mb=500,
        runtime=5,
    params:
        held_out=STUDY.folds.held_out,
        scanned=STUDY.cohort.scanned,
        code=code_of("scripts.prediction.list_folds"),
    message:
        "List the fold that holds each patient out"
    script:
        "../scripts/prediction/list_folds.py"


# What a method made elsewhere may read; the truth of the virtual cohort is not among it.
rule inputs:
    input:
        expand(
            "<results>/cases/{case}/{file}",
            case=STUDY.cohort.cases,
            file=["mesh.vtu", "model.h5", "plan.json"],
        ),
        expand("<results>/cases/{case}/postop.h5", case=STUDY.cohort.scanned),
        expand("<results>/cases/{case}/achieved.json", case=STUDY.cohort.registered),
        expand("<results>/cases/{case}/covariates.json", case=STUDY.cohort.described),
        "<results>/folds.csv",
    message:
        "Everything is there that a method may read"


# How far off a prediction may be, calibrated on held-out patients; not part of `all`.


# How much the networks differ; all but one have seen the patient's outcome.
rule predict_ensemble:
    input:
        models=["<results>/{home}/{case}/model.h5"],
        plans=lambda wildcards: [INPUTS.patient.motion(wildcards)],
        lifts=INPUTS.prediction.of_ensemble("lifts"),
        covariates=INPUTS.prediction.of_ensemble("covariates"),
        trained=INPUTS.prediction.of_ensemble("networks"),
    output:
        predictions="<results>/{home}/{case}{plan}/{method}/ensemble.h5",
    log:
        "<logs>/predict_ensemble/{home}/{case}{plan}_{method}.log",
    benchmark:
        "<benchmarks>/predict_ensemble/{home}/{case}{plan}_{method}.tsv"
    wildcard_constraints:
        home="cases",
        method=any_of(NETWORKS),
    conda:
        "../envs/pinnochio.yaml"
    resources:
        mem_mb=4000,
        runtime=20,
        gpu=GPU,
    params:
        names=INPUTS.prediction.of_ensemble("folds"),
        cases=lambda wildcards: [wildcards.case],
        predictor=INPUTS.prediction.predictor,
        settings=INPUTS.prediction.of_ensemble("settings"),
        code=code_with_method("scripts.prediction.predict"),
    message:
        "Predict {wildcards.case}{wildcards.plan} by every fold's {wildcards.method}"
    script:
        "../scripts/prediction/predict.py"


rule calibrate:
    input:
        models=lambda wildcards: [
            STUDY.model_of(case, wildcards.method) for case in STUDY.cohort.scanned
        ],
        postops=expand("<results>/cases/{case}/postop.h5", case=STUDY.cohort.scanned),
        judged=expand("<results>/cases/{case}/judged.h5", case=STUDY.cohort.scanned),
        # From the plan, which is all that a user has, where a method predicts from both motions.
        predictions=lambda wildcards: expand(
            "<results>/{arm}/{fold}/{method}/predictions.h5",
            arm="planned" if wildcards.method in STUDY.planned else "folds",
            fold=[STUDY.folds.by_case[case] for case in STUDY.cohort.scanned],
            method=wildcards.method,
        ),
        ensembles=lambda wildcards: expand(
            "<results>/cases/{case}/{method}/ensemble.h5",
            case=STUDY.cohort.scanned if wildcards.method in NETWORKS else [],
            method=wildcards.method,
        ),
        truths=lambda wildcards: [
            STUDY.model_of(case, wildcards.method).replace(
                "model.h5", "true_motion.h5"
            )
            for case in (STUDY.cohort.scanned if STUDY.cohort.virtual else [])
        ],
    output:
        calibration="<results>/methods/{method}/calibration.json",
        table=ensure("<results>/methods/{method}/coverage.csv", non_empty=True),
    log:
        "<logs>/calibrate/{method}.log",
    benchmark:
        "<benchmarks>/calibrate/{method}.tsv"
    wildcard_constraints:
        method=any_of(STUDY.methods.used),
    conda:
        "../envs/pinnochio.yaml"
    resources:
        mem_mb=2000,
        runtime=20,
    params:
        cases=STUDY.cohort.scanned,
        folds=[STUDY.folds.by_case[case] for case in STUDY.cohort.scanned],
        level=config["uncertainty"]["level"],
        seed=SEED,
        code=code_of("scripts.prediction.calibrate"),
    message:
        "Calibrate the interval of {wildcards.method} on held-out errors"
    script:
        "../scripts/prediction/calibrate.py"


rule uncertainty:
    input:
        recorded("coverage") if STUDY.methods.calibrated else [],
    message:
        "The intervals are calibrated"
