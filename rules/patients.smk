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
            "code": PREDICTS,
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


rule export_prediction:
    input:
        model="<results>/{home}/{case}/model.h5",
        plan="<results>/{home}/{case}{plan}/plan.json",
        result=INPUTS.patients.result,
    output:
        mesh="<results>/{home}/{case}{plan}/{method}/deformed.vtu",
        skin=expand(
            "<results>/{home}/{case}{plan}/{method}/skin.{kind}",
            kind=["vtp", "ply", "stl"],
            allow_missing=True,
        ),
        # One file per bone of the patient, which its segmentation tells.
        bones=directory("<results>/{home}/{case}{plan}/{method}/bones"),
    log:
        "<logs>/export_prediction/{home}/{case}{plan}_{method}.log",
    conda:
        "../envs/pinnochio.yaml"
    resources:
        mem_mb=2000,
        runtime=5,
    params:
        code=code_of("scripts.patients.export_prediction"),
    message:
        "Write the files of {wildcards.case}{wildcards.plan}"
    script:
        "../scripts/patients/export_prediction.py"


rule certify:
    input:
        model="<results>/{home}/{case}/model.h5",
        plan="<results>/{home}/{case}{plan}/plan.json",
        quality="<results>/{home}/{case}/quality.json",
        result=INPUTS.patients.result,
        archive=lambda wildcards: STUDY.choice.files,
    output:
        certificate="<results>/{home}/{case}{plan}/{method}/certificate.json",
    log:
        "<logs>/certify/{home}/{case}{plan}_{method}.log",
    conda:
        "../envs/pinnochio.yaml"
    resources:
        mem_mb=2000,
        runtime=10,
    params:
        corrections=lambda wildcards: STUDY.choice.corrections,
        expected=lambda wildcards: STUDY.choice.expected,
        archive=lambda wildcards: STUDY.choice.folder,
        fem=INPUTS.patient.setting("fem"),
        predicts=PREDICTS,
        code=code_of("scripts.patients.certify"),
    message:
        "Certify {wildcards.case}{wildcards.plan}"
    script:
        "../scripts/patients/certify.py"


rule show_prediction:
    input:
        model="<results>/{home}/{case}/model.h5",
        plan="<results>/{home}/{case}{plan}/plan.json",
        result=INPUTS.patients.result,
        certificate="<results>/{home}/{case}{plan}/{method}/certificate.json",
    output:
        page="<results>/{home}/{case}{plan}/{method}/index.html",
        measures="<results>/{home}/{case}{plan}/{method}/measures.csv",
    log:
        "<logs>/show_prediction/{home}/{case}{plan}_{method}.log",
    benchmark:
        "<benchmarks>/show_prediction/{home}/{case}{plan}_{method}.tsv"
    conda:
        "../envs/pinnochio.yaml"
    resources:
        mem_mb=2000,
        runtime=10,
    params:
        code=code_of("scripts.patients.show_prediction"),
    message:
        "Draw {wildcards.case}{wildcards.plan}"
    script:
        "../scripts/patients/show_prediction.py"


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
