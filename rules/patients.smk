# New patients, predicted by the models of an archive; not part of `all`. Nothing here trains.


rule describe_training:
    input:
        models=expand("<results>/cases/{case}/model.h5", case=STUDY.cohort.scanned),
        plans=expand("<results>/cases/{case}/plan.json", case=STUDY.cohort.scanned),
        qualities=expand(
            "<results>/cases/{case}/quality.json", case=STUDY.cohort.scanned
        ),
    output:
        ranges="<results>/methods/ranges.json",
    log:
        "<logs>/describe_training.log",
    conda:
        "../envs/pinnochio.yaml"
    resources:
        mem_mb=1000,
        runtime=10,
    params:
        cases=STUDY.cohort.scanned,
        code=code_of("scripts.patients.describe_training"),
    message:
        "Describe anatomy and plans of the training patients"
    script:
        "../scripts/patients/describe_training.py"


rule pack:
    input:
        networks=expand(
            "<results>/folds/{fold}/{method}/network.pt",
            method=INPUTS.patients.packed,
            fold=STUDY.folds.held_out,
        ),
        metrics=expand(
            "<results>/folds/{fold}/{method}/metrics.csv",
            method=INPUTS.patients.packed,
            fold=STUDY.folds.held_out,
        ),
        calibrations=expand(
            "<results>/methods/{method}/calibration.json",
            method=INPUTS.patients.packed_intervals,
        ),
        ranges="<results>/methods/ranges.json",
    output:
        manifest="<results>/archive/archive.json",
        ranges="<results>/archive/ranges.json",
        networks=expand(
            "<results>/archive/{method}/{fold}.pt",
            method=INPUTS.patients.packed,
            fold=STUDY.folds.held_out,
        ),
        calibrations=expand(
            "<results>/archive/{method}/calibration.json",
            method=INPUTS.patients.packed_intervals,
        ),
    log:
        "<logs>/pack.log",
    conda:
        "../envs/pinnochio.yaml"
    resources:
        mem_mb=1000,
        runtime=5,
    params:
        about={
            "cohort": COHORT,
            "patients": len(STUDY.cohort.scanned),
            "segments": config["segments"],
            "folds": list(STUDY.folds.held_out),
            "settings": {name: config[name] for name in READ_BY_NETWORKS},
            "configuration": INPUTS.patients.configuration,
            "code": INPUTS.patients.predicts,
        },
        calibrated=INPUTS.patients.packed_intervals,
        methods={
            name: {
                "corrections": STUDY.methods.registry[name].settings[
                    "newton_corrections"
                ],
                "lift": STUDY.methods.registry[name].lift,
            }
            for name in INPUTS.patients.packed
        },
        code=code_of("scripts.patients.pack"),
    message:
        "Pack the models that predict new patients"
    script:
        "../scripts/patients/pack.py"


rule archive:
    input:
        INPUTS.patients.archive,
    message:
        "The models are packed: see {config[pathvars][results]}/archive"


# Every plan has been read and checked before any heavy work starts; a further plan meshes nothing anew.
use rule check_cohort as check_patient with:
    input:
        imports=["<results>/patients/{case}/import.json"],
        plans=INPUTS.patients.plans,
    output:
        table=ensure("<results>/patients/{case}/imported.csv", non_empty=True),
    log:
        "<logs>/check_patient/{case}.log",
    params:
        cases=lambda wildcards: [wildcards.case],
        code=code_of("scripts.patient.check_cohort"),
    message:
        "All files of the new patient {wildcards.case} are read and checked"


# Before pictures of the patient.
rule predict_plan:
    input:
        model="<results>/{home}/{case}/model.h5",
        plan="<results>/{home}/{case}{plan}/plan.json",
        quality="<results>/{home}/{case}/quality.json",
        lifts=INPUTS.prediction.of_ensemble("lifts"),
        covariates=INPUTS.prediction.of_ensemble("covariates"),
        networks=INPUTS.prediction.of_ensemble("networks"),
        archive=lambda wildcards: STUDY.choice.files,
    output:
        **{name: update(file) for name, file in INPUTS.patients.fields.items()},
        certificate=update("<results>/{home}/{case}{plan}/{method}/certificate.json"),
        page=update("<results>/{home}/{case}{plan}/{method}/index.html"),
        measures=update("<results>/{home}/{case}{plan}/{method}/measures.csv"),
        mesh="<results>/{home}/{case}{plan}/{method}/deformed.vtu",
        skin=expand(
            "<results>/{home}/{case}{plan}/{method}/skin.{kind}",
            kind=["vtp", "ply", "stl"],
            allow_missing=True,
        ),
    log:
        "<logs>/predict_plan/{home}/{case}{plan}_{method}.log",
    benchmark:
        "<benchmarks>/predict_plan/{home}/{case}{plan}_{method}.tsv"
    wildcard_constraints:
        home="patients",
        plan="[/][^/]+",
        method=config["predict"]["method"] if not STUDY.choice else STUDY.choice.method,
    priority: 1
    conda:
        "../envs/pinnochio.yaml"
    resources:
        mem_mb=4000,
        runtime=30,
        gpu=lambda wildcards: GPU if STUDY.choice.archive else 0,
    params:
        folds=INPUTS.prediction.of_ensemble("folds"),
        predictor=INPUTS.prediction.predictor,
        settings=INPUTS.prediction.of_ensemble("settings"),
        others=INPUTS.prediction.others,
        seconds=lambda wildcards: STUDY.choice.seconds,
        fem=INPUTS.patient.setting("fem"),
        corrections=lambda wildcards: STUDY.choice.corrections,
        archive=lambda wildcards: STUDY.choice.folder,
        predicts=INPUTS.patients.predicts,
        content=content(lambda wildcards: STUDY.choice.files),
        code=code_with_method("scripts.patients.predict_plan"),
    message:
        "Predict {wildcards.case}{wildcards.plan}"
    script:
        "../scripts/patients/predict_plan.py"


rule show_plans:
    input:
        model="<results>/{home}/{case}/model.h5",
        plans=INPUTS.patients.plans,
        results=INPUTS.patients.results,
        certificates=INPUTS.patients.of_plans("certificate.json"),
        measures=INPUTS.patients.of_plans("measures.csv"),
    output:
        page="<results>/{home}/{case}/plans_{method}.html",
    log:
        "<logs>/show_plans/{home}/{case}_{method}.log",
    conda:
        "../envs/pinnochio.yaml"
    resources:
        mem_mb=2000,
        runtime=10,
    params:
        code=code_of("scripts.patients.show_plans"),
    message:
        "Lay the plans of {wildcards.case} side by side"
    script:
        "../scripts/patients/show_plans.py"


rule predict:
    input:
        INPUTS.patients.predictions,
    params:
        pages=lambda wildcards, input: " ".join(
            item for item in input if item.endswith(".html")
        ),
    message:
        "The new patients are predicted; open {params.pages}"
