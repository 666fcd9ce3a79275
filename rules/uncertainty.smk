# How far off a prediction may be: calibrated on held-out patients, shown for those without a scan; not part of `all`.


# Of a patient of the cohort all but one network have seen the outcome; of one without a scan none has.
rule predict_ensemble:
    input:
        model="<results>/cases/{case}/model.h5",
        plan="<results>/cases/{case}/plan.json",
        lifts=lifts_of(lambda wildcards: [wildcards.case]),
        networks=expand(
            "<results>/folds/{fold}/{method}/network.pt",
            fold=HELD_OUT,
            allow_missing=True,
        ),
    output:
        ensemble="<results>/cases/{case}/ensemble_{method}.h5",
    log:
        "<logs>/predict_ensemble/{case}_{method}.log",
    benchmark:
        "<benchmarks>/predict_ensemble/{case}_{method}.tsv"
    wildcard_constraints:
        method="|".join(VARIANTS) or "none",
    conda:
        "../envs/pinnochio.yaml"
    threads: 1
    resources:
        mem_mb=4000,
        runtime=20,
        gpu=GPU,
    params:
        folds=list(HELD_OUT),
        fem=config["fem"],
        corrections=settings_of("newton_corrections"),
        code=code_of("predict_ensemble"),
    message:
        "Predict {wildcards.case} by every fold's {wildcards.method}"
    script:
        "../scripts/predict_ensemble.py"


rule calibrate:
    input:
        models=expand("<results>/cases/{case}/model.h5", case=SCANNED),
        postops=expand("<results>/cases/{case}/postop.h5", case=SCANNED),
        predictions=expand(
            "<results>/folds/{fold}/{method}/predictions.h5",
            fold=[fold_of(case) for case in SCANNED],
            allow_missing=True,
        ),
        ensembles=expand(
            "<results>/cases/{case}/ensemble_{method}.h5",
            case=SCANNED,
            allow_missing=True,
        ),
    output:
        calibration="<results>/methods/{method}/calibration.json",
        table=ensure("<results>/methods/{method}/coverage.csv", non_empty=True),
    log:
        "<logs>/calibrate/{method}.log",
    benchmark:
        "<benchmarks>/calibrate/{method}.tsv"
    wildcard_constraints:
        method="|".join(VARIANTS) or "none",
    conda:
        "../envs/pinnochio.yaml"
    threads: 1
    resources:
        mem_mb=2000,
        runtime=20,
    params:
        cases=SCANNED,
        folds=[fold_of(case) for case in SCANNED],
        level=config["uncertainty"]["level"],
        seed=SEED,
        code=code_of("calibrate"),
    message:
        "Calibrate the interval of {wildcards.method} on held-out errors"
    script:
        "../scripts/calibrate.py"


rule predict_interval:
    input:
        model="<results>/cases/{case}/model.h5",
        ensemble="<results>/cases/{case}/ensemble_{method}.h5",
        calibration="<results>/methods/{method}/calibration.json",
    output:
        interval="<results>/cases/{case}/interval_{method}.h5",
        picture="<results>/cases/{case}/interval_{method}.png",
    log:
        "<logs>/predict_interval/{case}_{method}.log",
    benchmark:
        "<benchmarks>/predict_interval/{case}_{method}.tsv"
    wildcard_constraints:
        case="|".join(UNSCANNED) or "none",
        method="|".join(VARIANTS) or "none",
    conda:
        "../envs/pinnochio.yaml"
    threads: 1
    resources:
        mem_mb=2000,
        runtime=10,
    params:
        fem=config["fem"],
        code=code_of("predict_interval"),
    message:
        "Predict {wildcards.case} by {wildcards.method}, with its interval"
    script:
        "../scripts/predict_interval.py"


rule uncertainty:
    input:
        table_and_twins("coverage") if UNCERTAIN else [],
        expand(
            "<results>/cases/{case}/interval_{method}.{kind}",
            case=UNSCANNED,
            method=UNCERTAIN,
            kind=["h5", "png"],
        ),
    message:
        "The intervals are calibrated"
