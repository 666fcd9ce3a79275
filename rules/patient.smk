# What belongs to a patient, once for all plans: of the study (cases) or new (patients).


rule import_segmentation:
    input:
        segmentation=INPUTS.patient.file("segmentation"),
        volume=INPUTS.patient.file("volume"),
        markups=INPUTS.patient.markups,
    output:
        labels="<results>/{home}/{case}/labels.nii.gz",
        bone="<results>/{home}/{case}/bone.vtp",
        skin="<results>/{home}/{case}/skin.vtp",
        report="<results>/{home}/{case}/import.json",
    log:
        "<logs>/import_segmentation/{home}/{case}.log",
    benchmark:
        "<benchmarks>/import_segmentation/{home}/{case}.tsv"
    conda:
        "../envs/pinnochio.yaml"
    resources:
        mem_mb=lambda wildcards, input: 4000 + 30 * millions(input.segmentation),
        runtime=lambda wildcards, input: 10 + millions(input.segmentation) // 4,
    params:
        labels=config["labels"],
        segments=config["segments"],
        orientation=config["orientation"],
        repair=config["repair"],
        cuts=config["osteotomy"]["cuts"],
        accept=config["osteotomy"]["accept"],
        unlabelled_muscle=config["unlabelled_muscle"],
        bone_edge=INPUTS.patient.setting("mesh", "bone_edge"),
        content=content(
            INPUTS.patient.file("segmentation"),
            INPUTS.patient.file("volume"),
            INPUTS.patient.markups,
        ),
        code=code_of("scripts.patient.import_segmentation"),
    message:
        "Import the segmentation of {wildcards.case}"
    script:
        "../scripts/patient/import_segmentation.py"


# What was cut where, to look at.
rule show_segments:
    input:
        bone="<results>/{home}/{case}/bone.vtp",
        skin="<results>/{home}/{case}/skin.vtp",
        report="<results>/{home}/{case}/import.json",
    output:
        picture="<results>/{home}/{case}/segments.png",
    log:
        "<logs>/show_segments/{home}/{case}.log",
    conda:
        "../envs/pinnochio.yaml"
    resources:
        mem_mb=2000,
        runtime=5,
    params:
        code=code_of("scripts.patient.show_segments"),
    message:
        "Draw the bone segments of {wildcards.case}"
    script:
        "../scripts/patient/show_segments.py"


# Before the dearer stages: a wrong plan is refused at once.
rule import_plan:
    input:
        source=INPUTS.patient.plan,
        bone="<results>/{home}/{case}/bone.vtp",
        labels="<results>/{home}/{case}/labels.nii.gz",
    output:
        plan="<results>/{home}/{case}{plan}/plan.json",
    log:
        "<logs>/import_plan/{home}/{case}{plan}.log",
    priority: 1
    conda:
        "../envs/pinnochio.yaml"
    resources:
        mem_mb=3000,
        runtime=10,
    params:
        labels=config["labels"],
        limit=config["registration"]["segment_limit"],
        share=config["registration"]["segment_share"],
        # The plan of a new patient's folder is the patient's, whatever case it names; what is odd was said before.
        foreign=lambda wildcards: wildcards.home == "patients",
        content=content(INPUTS.patient.plan),
        code=code_of("scripts.patient.import_plan"),
    message:
        "Import the plan of {wildcards.case}{wildcards.plan}"
    script:
        "../scripts/patient/import_plan.py"


rule register_postop:
    input:
        postop=INPUTS.patient.postop,
        # Of the scan that the skin is of too, where that is said.
        postop_bones=INPUTS.patient.bones_of_postop,
        labels=INPUTS.patient.labels_of_postop,
        skin="<results>/cases/{case}/skin.vtp",
        bone="<results>/cases/{case}/bone.vtp",
    output:
        postop="<results>/cases/{case}/postop.h5",
    log:
        "<logs>/register_postop/{case}.log",
    benchmark:
        "<benchmarks>/register_postop/{case}.tsv"
    conda:
        "../envs/pinnochio.yaml"
    resources:
        mem_mb=4000,
        runtime=10,
    params:
        labels=config["labels"],
        nasion_above_maxilla=config["interfaces"]["nasion_above_maxilla"],
        limit=config["registration"]["limit"],
        segment_limit=config["registration"]["segment_limit"],
        segment_share=config["registration"]["segment_share"],
        content=content(INPUTS.patient.postop, INPUTS.patient.bones_of_postop),
        code=code_of("scripts.patient.register_postop"),
    message:
        "Register the post-operative skin of {wildcards.case}"
    script:
        "../scripts/patient/register_postop.py"


# The motion that surgery gave each segment; what explains the scanned bones badly is refused.
rule register_segments:
    input:
        postop_bones=INPUTS.patient.postop_bones,
        labels="<results>/cases/{case}/labels.nii.gz",
        bone="<results>/cases/{case}/bone.vtp",
        plan="<results>/cases/{case}/plan.json",
    output:
        achieved="<results>/cases/{case}/achieved.json",
        fits=ensure("<results>/cases/{case}/segments.csv", non_empty=True),
    log:
        "<logs>/register_segments/{case}.log",
    benchmark:
        "<benchmarks>/register_segments/{case}.tsv"
    conda:
        "../envs/pinnochio.yaml"
    resources:
        mem_mb=4000,
        runtime=10,
    params:
        labels=config["labels"],
        limit=config["registration"]["segment_limit"],
        share=config["registration"]["segment_share"],
        content=content(INPUTS.patient.postop_bones),
        code=code_of("scripts.patient.register_segments"),
    message:
        "Register the bones of {wildcards.case} after surgery"
    script:
        "../scripts/patient/register_segments.py"


rule import_covariates:
    input:
        source=INPUTS.patient.file("covariates_file"),
    output:
        covariates="<results>/{home}/{case}/covariates.json",
    log:
        "<logs>/import_covariates/{home}/{case}.log",
    conda:
        "../envs/pinnochio.yaml"
    resources:
        mem_mb=500,
        runtime=5,
    params:
        known=INPUTS.patient.covariates,
        code=code_of("scripts.patient.import_covariates"),
    message:
        "Write down what else is known of {wildcards.case}"
    script:
        "../scripts/patient/import_covariates.py"


# Every file that a user gave has been read and checked before any heavy work starts.
rule check_cohort:
    input:
        imports=expand("<results>/cases/{case}/import.json", case=STUDY.cohort.cases),
        plans=expand("<results>/cases/{case}/plan.json", case=STUDY.cohort.cases),
        postops=expand(
            "<results>/cases/{case}/postop.h5",
            case=[] if STUDY.cohort.virtual else STUDY.cohort.scanned,
        ),
        achieved=expand(
            "<results>/cases/{case}/achieved.json",
            case=[] if STUDY.cohort.virtual else STUDY.cohort.registered,
        ),
    output:
        table=ensure("<results>/cohort.csv", non_empty=True),
    log:
        "<logs>/check_cohort.log",
    conda:
        "../envs/pinnochio.yaml"
    resources:
        mem_mb=1000,
        runtime=5,
    params:
        cases=list(STUDY.cohort.cases),
        code=code_of("scripts.patient.check_cohort"),
    message:
        "All {input.imports} are read and checked"
    script:
        "../scripts/patient/check_cohort.py"


# What no plan decides, in one job; a killed one goes on at its stage.
rule model_patient:
    input:
        labels="<results>/{home}/{case}/labels.nii.gz",
        bone="<results>/{home}/{case}/bone.vtp",
        skin="<results>/{home}/{case}/skin.vtp",
        report="<results>/{home}/{case}/import.json",
        checked=ancient(INPUTS.patient.file("checked")),
    output:
        **{name: update(file) for name, file in INPUTS.patient.lift.items()},
        mesh=update("<results>/{home}/{case}/mesh.vtu"),
        model=update("<results>/{home}/{case}/model.h5"),
        quality=update("<results>/{home}/{case}/quality.json"),
    log:
        "<logs>/model_patient/{home}/{case}.log",
    benchmark:
        "<benchmarks>/model_patient/{home}/{case}.tsv"
    conda:
        "../envs/pinnochio.yaml"
    resources:
        mem_mb=lambda wildcards, input: 4000 + 60 * millions(input.labels),
        runtime=60,
    params:
        nodes=INPUTS.patient.nodes,
        minimum_dihedral=INPUTS.patient.setting("mesh", "minimum_dihedral"),
        interfaces=INPUTS.patient.setting("interfaces"),
        controls=INPUTS.patient.setting("lift", "controls"),
        fem=INPUTS.patient.setting("fem"),
        code=code_of("scripts.patient.model_patient"),
    message:
        "Mesh and label {wildcards.case}"
    script:
        "../scripts/patient/model_patient.py"


# On another mesh than the study's.
use rule model_patient as model_sized with:
    output:
        mesh=update("<results>/{home}/{case}/nodes_{nodes}/mesh.vtu"),
        model=update("<results>/{home}/{case}/nodes_{nodes}/model.h5"),
    log:
        "<logs>/model_sized/{home}/{case}_{nodes}.log",
    benchmark:
        "<benchmarks>/model_sized/{home}/{case}_{nodes}.tsv"
    message:
        "Mesh and label {wildcards.case} with {wildcards.nodes} nodes"


# The lift where it does not come with the model: no network of the study wants one, or the mesh is another.
rule make_lift:
    input:
        model="<results>/{home}/{case}{mesh}/model.h5",
    output:
        lift="<results>/{home}/{case}{mesh}/lift_elastic.h5",
    log:
        "<logs>/make_lift/{home}/{case}{mesh}.log",
    benchmark:
        "<benchmarks>/make_lift/{home}/{case}{mesh}.tsv"
    conda:
        "../envs/pinnochio.yaml"
    resources:
        mem_mb=4000,
        runtime=30,
    params:
        controls=INPUTS.patient.setting("lift", "controls"),
        fem=INPUTS.patient.setting("fem"),
        code=code_of("scripts.patient.make_lift"),
    message:
        "Make the lift of {wildcards.case}{wildcards.mesh}"
    script:
        "../scripts/patient/make_lift.py"


ruleorder: model_patient > make_lift


# For the methods that resolve the lips: their mesh, its model, and the true motion there where it is known.
rule model_lips:
    input:
        mesh="<results>/cases/{case}/mesh.vtu",
        labels="<results>/cases/{case}/labels.nii.gz",
        bone="<results>/cases/{case}/bone.vtp",
        skin="<results>/cases/{case}/skin.vtp",
        report="<results>/cases/{case}/import.json",
        truth=INPUTS.patient.truth,
    output:
        **INPUTS.patient.true_motion("lips/"),
        mesh="<results>/cases/{case}/lips/mesh.vtu",
        model="<results>/cases/{case}/lips/model.h5",
    log:
        "<logs>/model_lips/{case}.log",
    benchmark:
        "<benchmarks>/model_lips/{case}.tsv"
    conda:
        "../envs/pinnochio.yaml"
    resources:
        mem_mb=2000,
        runtime=10,
    params:
        interfaces=config["interfaces"],
        lip_edge=config["fem_rlse"]["lip_edge"],
        code=code_of("scripts.patient.model_lips"),
    message:
        "Refine the mesh of {wildcards.case} around the mouth, and label it"
    script:
        "../scripts/patient/model_lips.py"


# Before any method predicts, and by none of them.
rule choose_samples:
    input:
        model="<results>/cases/{case}/model.h5",
        plan=INPUTS.patient.motion,
        postop="<results>/cases/{case}/postop.h5",
        truth=INPUTS.patient.truth,
    output:
        **INPUTS.patient.true_motion(),
        judged="<results>/cases/{case}/judged.h5",
    log:
        "<logs>/choose_samples/{case}.log",
    benchmark:
        "<benchmarks>/choose_samples/{case}.tsv"
    conda:
        "../envs/pinnochio.yaml"
    resources:
        mem_mb=2000,
        runtime=10,
    params:
        samples=config["evaluation"]["samples"],
        seed=SEED,
        code=code_of("scripts.patient.choose_samples"),
    message:
        "Choose where {wildcards.case} is judged"
    script:
        "../scripts/patient/choose_samples.py"


rule meshes:
    input:
        expand("<results>/cases/{case}/model.h5", case=STUDY.cohort.cases),
    message:
        "All patients are meshed and labelled"


rule show_quality:
    input:
        model="<results>/{home}/{case}/model.h5",
    output:
        picture="<results>/{home}/{case}/quality.png",
    log:
        "<logs>/show_quality/{home}/{case}.log",
    conda:
        "../envs/pinnochio.yaml"
    resources:
        mem_mb=2000,
        runtime=5,
    params:
        code=code_of("scripts.patient.show_quality"),
    message:
        "Draw the model of {wildcards.case}"
    script:
        "../scripts/patient/show_quality.py"


rule quality:
    input:
        table_and_twins("quality"),
        expand("<results>/cases/{case}/quality.png", case=STUDY.cohort.cases),
    message:
        "The quality of every patient's model is reported"
