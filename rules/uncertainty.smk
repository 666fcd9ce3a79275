# How far off a prediction may be: calibrated on held-out patients, shown for those without a scan; not part of `all`.


# Of a patient of the cohort all but one network have seen the outcome; of one without a scan none has.
rule predict_ensemble:
    input:
        model="<results>/{home}/{case}/model.h5",
        plan=STUDY.motion,
        lifts=STUDY.of_ensemble("lifts"),
        covariates=STUDY.of_ensemble("covariates"),
        networks=STUDY.of_ensemble("networks"),
    output:
        ensemble="<results>/{home}/{case}{plan}/{method}/ensemble.h5",
    log:
        "<logs>/predict_ensemble/{home}/{case}{plan}_{method}.log",
    benchmark:
        "<benchmarks>/predict_ensemble/{home}/{case}{plan}_{method}.tsv"
    wildcard_constraints:
        method=any_of([*NETWORKS, config["predict"]["method"]]),
    conda:
        "../envs/pinnochio.yaml"
    threads: 1
    resources:
        mem_mb=4000,
        runtime=20,
        gpu=GPU,
    params:
        folds=STUDY.of_ensemble("folds"),
        predictor=STUDY.predictor,
        settings=STUDY.of_ensemble("settings"),
        code=code_with_method("predict_ensemble"),
    message:
        "Predict {wildcards.case}{wildcards.plan} by every fold's {wildcards.method}"
    script:
        "../scripts/predict_ensemble.py"


rule calibrate:
    input:
        models=lambda wildcards: [
            STUDY.model_of(case, wildcards.method) for case in STUDY.scanned
        ],
        postops=expand("<results>/cases/{case}/postop.h5", case=STUDY.scanned),
        judged=expand("<results>/cases/{case}/judged.h5", case=STUDY.scanned),
        predictions=expand(
            "<results>/folds/{fold}/{method}/predictions.h5",
            fold=[STUDY.fold_of(case) for case in STUDY.scanned],
            allow_missing=True,
        ),
        ensembles=lambda wildcards: expand(
            "<results>/cases/{case}/{method}/ensemble.h5",
            case=STUDY.scanned if wildcards.method in NETWORKS else [],
            method=wildcards.method,
        ),
    output:
        calibration="<results>/methods/{method}/calibration.json",
        table=ensure("<results>/methods/{method}/coverage.csv", non_empty=True),
    log:
        "<logs>/calibrate/{method}.log",
    benchmark:
        "<benchmarks>/calibrate/{method}.tsv"
    wildcard_constraints:
        method=any_of(STUDY.methods),
    conda:
        "../envs/pinnochio.yaml"
    threads: 1
    resources:
        mem_mb=2000,
        runtime=20,
    params:
        cases=STUDY.scanned,
        folds=[STUDY.fold_of(case) for case in STUDY.scanned],
        level=config["uncertainty"]["level"],
        seed=SEED,
        code=code_of("calibrate"),
    message:
        "Calibrate the interval of {wildcards.method} on held-out errors"
    script:
        "../scripts/calibrate.py"


# Of a patient with a scan there is none: all but one network have seen the outcome.
rule predict_interval:
    input:
        model="<results>/{home}/{case}/model.h5",
        plan="<results>/{home}/{case}{plan}/plan.json",
        quality="<results>/{home}/{case}/quality.json",
        ensemble="<results>/{home}/{case}{plan}/{method}/ensemble.h5",
        calibration=STUDY.of_ensemble("calibration"),
        ranges=STUDY.of_ensemble("ranges"),
    output:
        interval="<results>/{home}/{case}{plan}/{method}/interval.h5",
        picture="<results>/{home}/{case}{plan}/{method}/interval.png",
    log:
        "<logs>/predict_interval/{home}/{case}{plan}_{method}.log",
    benchmark:
        "<benchmarks>/predict_interval/{home}/{case}{plan}_{method}.tsv"
    wildcard_constraints:
        case=any_of([*STUDY.unscanned, *STUDY.patients]),
        method=any_of([*NETWORKS, config["predict"]["method"]]),
    conda:
        "../envs/pinnochio.yaml"
    threads: 1
    resources:
        mem_mb=2000,
        runtime=10,
    params:
        fem=STUDY.of_patient("fem"),
        code=code_of("predict_interval"),
    message:
        "Predict {wildcards.case}{wildcards.plan} by {wildcards.method}, with its interval"
    script:
        "../scripts/predict_interval.py"


rule uncertainty:
    input:
        recorded("coverage") if STUDY.covered else [],
        expand(
            "<results>/cases/{case}/{method}/interval.{kind}",
            case=STUDY.unscanned,
            method=[method for method in STUDY.covered if method in NETWORKS],
            kind=["h5", "png"],
        ),
    message:
        "The intervals are calibrated"
