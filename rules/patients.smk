# New patients, predicted by the models of an archive; not part of `all`. Nothing here trains.


rule describe_training:
    input:
        models=expand("<results>/cases/{case}/model.h5", case=SCANNED),
        plans=expand("<results>/cases/{case}/plan.json", case=SCANNED),
        qualities=expand("<results>/cases/{case}/quality.json", case=SCANNED),
    output:
        ranges="<results>/methods/ranges.json",
    log:
        "<logs>/describe_training.log",
    conda:
        "../envs/pinnochio.yaml"
    threads: 1
    resources:
        mem_mb=1000,
        runtime=10,
    params:
        cases=SCANNED,
        code=code_of("describe_training"),
    message:
        "Describe anatomy and plans of the training patients"
    script:
        "../scripts/describe_training.py"


rule pack:
    input:
        networks=expand(
            "<results>/folds/{fold}/{method}/network.pt", method=PACKED, fold=HELD_OUT
        ),
        metrics=expand(
            "<results>/folds/{fold}/{method}/metrics.csv", method=PACKED, fold=HELD_OUT
        ),
        calibrations=expand(
            "<results>/methods/{method}/calibration.json", method=PACKED
        ),
        ranges="<results>/methods/ranges.json",
    output:
        manifest="<results>/archive/archive.json",
        ranges="<results>/archive/ranges.json",
        networks=expand(
            "<results>/archive/{method}/{fold}.pt", method=PACKED, fold=HELD_OUT
        ),
        calibrations=expand(
            "<results>/archive/{method}/calibration.json", method=PACKED
        ),
    log:
        "<logs>/pack.log",
    conda:
        "../envs/pinnochio.yaml"
    threads: 1
    resources:
        mem_mb=1000,
        runtime=5,
    params:
        about={
            "cohort": COHORT,
            "patients": len(SCANNED),
            "segments": config["segments"],
            "folds": list(HELD_OUT),
            "settings": {name: config[name] for name in READ_BY_NETWORKS},
            "configuration": CONFIGURATION,
            "code": code_of("import_segmentation", "label_interfaces", "predict_ensemble"),
        },
        methods={
            name: {
                "corrections": VARIANTS[name]["newton_corrections"],
                "lift": VARIANTS[name]["network"]["lift"],
            }
            for name in PACKED
        },
    message:
        "Pack the models that predict new patients"
    script:
        "../scripts/pack.py"


rule archive:
    input:
        archived,
    message:
        "The models are packed: see {config[pathvars][results]}/archive"


# What belongs to the patient, once for all plans.
use rule import_segmentation as import_patient with:
    input:
        segmentation=lambda wildcards: PATIENTS[wildcards.case].segmentation,
    output:
        labels="<results>/patients/{case}/labels.nii.gz",
        bone="<results>/patients/{case}/bone.vtp",
        skin="<results>/patients/{case}/skin.vtp",
        report="<results>/patients/{case}/import.json",
    log:
        "<logs>/import_patient/{case}.log",
    benchmark:
        "<benchmarks>/import_patient/{case}.tsv"
    params:
        labels=config["labels"],
        segments=config["segments"],
        orientation=config["orientation"],
        repair=config["repair"],
        unlabelled_muscle=config["unlabelled_muscle"],
        bone_edge=lambda wildcards: CHOICE.settings["mesh"]["bone_edge"],
        code=code_of("import_segmentation"),
    message:
        "Import the segmentation of the new patient {wildcards.case}"


rule import_plan:
    input:
        source=lambda wildcards: PATIENTS[wildcards.case].plans[wildcards.plan],
        bone="<results>/patients/{case}/bone.vtp",
    output:
        plan="<results>/patients/{case}/{plan}/plan.json",
    log:
        "<logs>/import_plan/{case}_{plan}.log",
    conda:
        "../envs/pinnochio.yaml"
    threads: 1
    resources:
        mem_mb=1000,
        runtime=5,
    params:
        segments=config["segments"],
        code=code_of("import_plan"),
    message:
        "Import the plan {wildcards.plan} of the new patient {wildcards.case}"
    script:
        "../scripts/import_plan.py"


# Every plan has been read and checked before any heavy work starts.
use rule check_cohort as check_patient with:
    input:
        imports=["<results>/patients/{case}/import.json"],
        plans=plans_of_patient,
    output:
        table=ensure("<results>/patients/{case}/imported.csv", non_empty=True),
    log:
        "<logs>/check_patient/{case}.log",
    params:
        cases=lambda wildcards: [wildcards.case],
        code=code_of("check_cohort"),
    message:
        "All files of the new patient {wildcards.case} are read and checked"


use rule tetrahedralize as mesh_patient with:
    input:
        labels="<results>/patients/{case}/labels.nii.gz",
        checked=ancient("<results>/patients/{case}/imported.csv"),
    output:
        mesh="<results>/patients/{case}/mesh.vtu",
    log:
        "<logs>/mesh_patient/{case}.log",
    benchmark:
        "<benchmarks>/mesh_patient/{case}.tsv"
    params:
        nodes=lambda wildcards: CHOICE.settings["mesh"]["nodes"],
        minimum_dihedral=lambda wildcards: CHOICE.settings["mesh"]["minimum_dihedral"],
        code=code_of("tetrahedralize"),


use rule label_interfaces as label_patient with:
    input:
        mesh="<results>/patients/{case}/mesh.vtu",
        labels="<results>/patients/{case}/labels.nii.gz",
        bone="<results>/patients/{case}/bone.vtp",
        skin="<results>/patients/{case}/skin.vtp",
        report="<results>/patients/{case}/import.json",
    output:
        model="<results>/patients/{case}/model.h5",
    log:
        "<logs>/label_patient/{case}.log",
    benchmark:
        "<benchmarks>/label_patient/{case}.tsv"
    params:
        segments=config["segments"],
        interfaces=chosen("interfaces"),
        code=code_of("label_interfaces"),


use rule report_quality as report_patient with:
    input:
        model="<results>/patients/{case}/model.h5",
        imported="<results>/patients/{case}/import.json",
    output:
        report="<results>/patients/{case}/quality.json",
        picture="<results>/patients/{case}/quality.png",
    log:
        "<logs>/report_patient/{case}.log",
    benchmark:
        "<benchmarks>/report_patient/{case}.tsv"


use rule make_lift as lift_patient with:
    input:
        model="<results>/patients/{case}/model.h5",
    output:
        lift="<results>/patients/{case}/lift_{kind}.h5",
    log:
        "<logs>/lift_patient/{case}_{kind}.log",
    benchmark:
        "<benchmarks>/lift_patient/{case}_{kind}.tsv"
    params:
        controls=lambda wildcards: CHOICE.settings["lift"]["controls"],
        fem=chosen("fem"),
        code=code_of("make_lift"),


# One plan: by every fold's network, as patients without a scan are, or by a method without training.
use rule predict_ensemble as ensemble_patient with:
    input:
        model="<results>/patients/{case}/model.h5",
        plan="<results>/patients/{case}/{plan}/plan.json",
        lifts=lift_of_patient,
        networks=lambda wildcards: CHOICE.networks,
    output:
        ensemble="<results>/patients/{case}/{plan}/{method}/ensemble.h5",
    log:
        "<logs>/ensemble_patient/{case}_{plan}_{method}.log",
    benchmark:
        "<benchmarks>/ensemble_patient/{case}_{plan}_{method}.tsv"
    wildcard_constraints:
        method=config["predict"]["method"],
    params:
        folds=lambda wildcards: CHOICE.archive.folds,
        fem=chosen("fem"),
        corrections=lambda wildcards: CHOICE.corrections,
        code=code_of("predict_ensemble"),
    message:
        "Predict {wildcards.plan} of {wildcards.case} by every fold's {wildcards.method}"


use rule predict_interval as interval_patient with:
    input:
        model="<results>/patients/{case}/model.h5",
        ensemble="<results>/patients/{case}/{plan}/{method}/ensemble.h5",
        calibration=lambda wildcards: CHOICE.calibration,
    output:
        interval="<results>/patients/{case}/{plan}/{method}/interval.h5",
        picture="<results>/patients/{case}/{plan}/{method}/interval.png",
    log:
        "<logs>/interval_patient/{case}_{plan}_{method}.log",
    benchmark:
        "<benchmarks>/interval_patient/{case}_{plan}_{method}.tsv"
    wildcard_constraints:
        case="|".join(PATIENTS) or "none",
        method=config["predict"]["method"],
    params:
        fem=chosen("fem"),
        code=code_of("predict_interval"),


use rule predict_fem as fem_patient with:
    input:
        models=["<results>/patients/{case}/model.h5"],
        plans=["<results>/patients/{case}/{plan}/plan.json"],
    output:
        predictions="<results>/patients/{case}/{plan}/{method}/predictions.h5",
    log:
        "<logs>/fem_patient/{case}_{plan}_{method}.log",
    benchmark:
        "<benchmarks>/fem_patient/{case}_{plan}_{method}.tsv"
    threads: 1
    params:
        cases=lambda wildcards: [wildcards.case],
        arm=lambda wildcards: ARMS[wildcards.method],
        fem=chosen("fem"),
        apart=0,
        code=code_of("predict_fem"),
    message:
        "Predict {wildcards.plan} of {wildcards.case} by {wildcards.method}"


use rule predict_elastic as elastic_patient with:
    input:
        models=["<results>/patients/{case}/model.h5"],
        plans=["<results>/patients/{case}/{plan}/plan.json"],
    output:
        predictions="<results>/patients/{case}/{plan}/{method}/predictions.h5",
    log:
        "<logs>/elastic_patient/{case}_{plan}_{method}.log",
    benchmark:
        "<benchmarks>/elastic_patient/{case}_{plan}_{method}.tsv"
    wildcard_constraints:
        method="elastic",
    threads: 1
    params:
        cases=lambda wildcards: [wildcards.case],
        fem=chosen("fem"),
        code=code_of("predict_elastic"),
    message:
        "Predict {wildcards.plan} of {wildcards.case} by {wildcards.method}"


rule export_prediction:
    input:
        model="<results>/patients/{case}/model.h5",
        plan="<results>/patients/{case}/{plan}/plan.json",
        result=result_of_patient,
    output:
        mesh="<results>/patients/{case}/{plan}/{method}/deformed.vtu",
        skin=expand(
            "<results>/patients/{case}/{plan}/{method}/skin.{kind}",
            kind=["vtp", "ply", "stl"],
            allow_missing=True,
        ),
        bones=expand(
            "<results>/patients/{case}/{plan}/{method}/bone_{bone}.stl",
            bone=["cranium", *config["segments"]],
            allow_missing=True,
        ),
    log:
        "<logs>/export_prediction/{case}_{plan}_{method}.log",
    conda:
        "../envs/pinnochio.yaml"
    threads: 1
    resources:
        mem_mb=2000,
        runtime=5,
    params:
        code=code_of("export_prediction"),
    message:
        "Write the files of {wildcards.plan} of {wildcards.case}"
    script:
        "../scripts/export_prediction.py"


rule certify:
    input:
        model="<results>/patients/{case}/model.h5",
        plan="<results>/patients/{case}/{plan}/plan.json",
        quality="<results>/patients/{case}/quality.json",
        result=result_of_patient,
        archive=lambda wildcards: CHOICE.files,
    output:
        certificate="<results>/patients/{case}/{plan}/{method}/certificate.json",
    log:
        "<logs>/certify/{case}_{plan}_{method}.log",
    conda:
        "../envs/pinnochio.yaml"
    threads: 1
    resources:
        mem_mb=2000,
        runtime=10,
    params:
        corrections=lambda wildcards: CHOICE.corrections,
        expected=lambda wildcards: CHOICE.expected,
        archive=lambda wildcards: CHOICE.folder,
        fem=chosen("fem"),
        code=code_of("certify"),
        own=code_of("certify"),
    message:
        "Certify {wildcards.plan} of {wildcards.case}"
    script:
        "../scripts/certify.py"


rule show_prediction:
    input:
        model="<results>/patients/{case}/model.h5",
        plan="<results>/patients/{case}/{plan}/plan.json",
        result=result_of_patient,
        certificate="<results>/patients/{case}/{plan}/{method}/certificate.json",
    output:
        page="<results>/patients/{case}/{plan}/{method}/index.html",
    log:
        "<logs>/show_prediction/{case}_{plan}_{method}.log",
    benchmark:
        "<benchmarks>/show_prediction/{case}_{plan}_{method}.tsv"
    conda:
        "../envs/pinnochio.yaml"
    threads: 1
    resources:
        mem_mb=2000,
        runtime=10,
    params:
        code=code_of("show_prediction"),
    message:
        "Draw {wildcards.plan} of {wildcards.case}"
    script:
        "../scripts/show_prediction.py"


rule predict:
    input:
        results_of_patients,
    message:
        "The new patients are predicted: see {config[pathvars][results]}/patients"


# The patient with its models, for a person who tries plans: scripts/plan.py.
rule prepare_planner:
    input:
        model="<results>/patients/{case}/model.h5",
        lifts=lift_of_patient,
        quality="<results>/patients/{case}/quality.json",
        plans=plans_of_patient,
        archive=lambda wildcards: CHOICE.files,
    output:
        given="<results>/patients/{case}/planner.json",
    log:
        "<logs>/prepare_planner/{case}.log",
    conda:
        "../envs/pinnochio.yaml"
    threads: 1
    resources:
        mem_mb=1000,
        runtime=5,
    params:
        settings=lambda wildcards: {
            "home": PATIENTS[wildcards.case].home,
            "archive": CHOICE.folder,
            "method": CHOICE.method,
            "corrections": CHOICE.corrections,
            "fem": CHOICE.settings["fem"],
        },
        code=code_of("prepare_planner"),
    message:
        "Prepare {wildcards.case} for the planner"
    script:
        "../scripts/prepare_planner.py"


rule planner:
    input:
        planners_of_patients,
    message:
        "Open the planner: python scripts/plan.py {input}"
