# What belongs to a patient, once for all plans: of the study (cases) or new (patients).

REGISTERED = "none" if STUDY.cohort.virtual else STUDY.wildcards["case"]


# All that is brought of a case before surgery, in one job: a wrong plan is refused before the dearer stages.
rule import_case:
    input:
        segmentation=INPUTS.patient.file("segmentation"),
        volume=INPUTS.patient.file("volume"),
        markups=INPUTS.patient.markups,
        source=INPUTS.patient.plan,
        described=INPUTS.patient.file("covariates_file"),
    output:
        covariates=update("<results>/cases/{case}/covariates.json"),
        labels=update("<results>/cases/{case}/labels.nii.gz"),
        bone=update("<results>/cases/{case}/bone.vtp"),
        skin=update("<results>/cases/{case}/skin.vtp"),
        report=update("<results>/cases/{case}/import.json"),
        plan=update("<results>/cases/{case}/plan.json"),
    log:
        "<logs>/import_case/{case}.log",
    benchmark:
        "<benchmarks>/import_case/{case}.tsv"
    conda:
        "../envs/pinnochio.yaml"
    resources:
        mem_mb=megabytes(lambda _, files: 4000 + 30 * millions(files.segmentation)),
        runtime=lambda wildcards, input: 10 + millions(input.segmentation) // 4,
    params:
        labels=config["labels"],
        segments=config["segments"],
        orientation=config["orientation"],
        repair=config["repair"],
        cuts=config["osteotomy"]["cuts"],
        accept=config["osteotomy"]["accept"],
        unlabelled_muscle=config["unlabelled_muscle"],
        bone_edge=config["mesh"]["bone_edge"],
        limit=config["registration"]["segment_limit"],
        share=config["registration"]["segment_share"],
        foreign=False,
        known=INPUTS.patient.covariates,
        content=content(
            INPUTS.patient.file("segmentation"),
            INPUTS.patient.file("volume"),
            INPUTS.patient.markups,
            INPUTS.patient.plan,
            INPUTS.patient.file("covariates_file"),
        ),
        code=code_of("scripts.patient.import_case"),
    message:
        "Import segmentation and plan of {wildcards.case}"
    script:
        "../scripts/patient/import_case.py"


# Of a new patient apart: there may be several plans, or none yet.
use rule import_case as import_segmentation with:
    input:
        segmentation=INPUTS.patient.file("segmentation"),
        volume=INPUTS.patient.file("volume"),
        markups=INPUTS.patient.markups,
    output:
        labels=update("<results>/{home}/{case}/labels.nii.gz"),
        bone=update("<results>/{home}/{case}/bone.vtp"),
        skin=update("<results>/{home}/{case}/skin.vtp"),
        report=update("<results>/{home}/{case}/import.json"),
    log:
        "<logs>/import_segmentation/{home}/{case}.log",
    benchmark:
        "<benchmarks>/import_segmentation/{home}/{case}.tsv"
    wildcard_constraints:
        home="patients",
    params:
        bone_edge=INPUTS.patient.setting("mesh", "bone_edge"),
        known=None,
        content=content(
            INPUTS.patient.file("segmentation"),
            INPUTS.patient.file("volume"),
            INPUTS.patient.markups,
        ),
    message:
        "Import the segmentation of {wildcards.case}"


use rule import_case as import_plan with:
    input:
        source=INPUTS.patient.plan,
        bone="<results>/{home}/{case}/bone.vtp",
        labels="<results>/{home}/{case}/labels.nii.gz",
    output:
        plan=update("<results>/{home}/{case}{plan}/plan.json"),
    log:
        "<logs>/import_plan/{home}/{case}{plan}.log",
    benchmark:
        "<benchmarks>/import_plan/{home}/{case}{plan}.tsv"
    wildcard_constraints:
        home="patients",
    priority: 1
    resources:
        mem_mb=3000,
        runtime=10,
    params:
        # The plan of a new patient's folder is the patient's, whatever case it names; what is odd was said before.
        foreign=True,
        known=None,
        content=content(INPUTS.patient.plan),
    message:
        "Import the plan of {wildcards.case}{wildcards.plan}"


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


# After surgery, where both scans are there and the truth is known: the registered skin, the motion that surgery gave each
# segment (what explains the scanned bones badly is refused), and where methods are judged, by none of them.
rule follow_up:
    input:
        scan=INPUTS.patient.postop,
        postop_bones=INPUTS.patient.postop_bones,
        labels="<results>/cases/{case}/labels.nii.gz",
        skin="<results>/cases/{case}/skin.vtp",
        bone="<results>/cases/{case}/bone.vtp",
        plan="<results>/cases/{case}/plan.json",
        model="<results>/cases/{case}/model.h5",
        lips_model="<results>/cases/{case}/lips/model.h5",
        truth="<results>/virtual/{case}/truth.h5",
    output:
        postop=update("<results>/cases/{case}/postop.h5"),
        achieved=update("<results>/cases/{case}/achieved.json"),
        fits=ensure(update("<results>/cases/{case}/segments.csv"), non_empty=True),
        judged=update("<results>/cases/{case}/judged.h5"),
        true_motion=update("<results>/cases/{case}/true_motion.h5"),
        lips_motion=update("<results>/cases/{case}/lips/true_motion.h5"),
    log:
        "<logs>/follow_up/{case}.log",
    benchmark:
        "<benchmarks>/follow_up/{case}.tsv"
    wildcard_constraints:
        case=STUDY.wildcards["case"] if STUDY.cohort.virtual else "none",
    conda:
        "../envs/pinnochio.yaml"
    resources:
        mem_mb=megabytes(4000),
        runtime=20,
    params:
        labels=config["labels"],
        nasion_above_maxilla=config["interfaces"]["nasion_above_maxilla"],
        limit=config["registration"]["limit"],
        segment_limit=config["registration"]["segment_limit"],
        segment_share=config["registration"]["segment_share"],
        motion="plan" if config["motion"] == "planned" else "achieved",
        samples=config["evaluation"]["samples"],
        seed=SEED,
        code=code_of("scripts.patient.follow_up"),
    message:
        "Register what was scanned of {wildcards.case} after surgery, and choose where it is judged"
    script:
        "../scripts/patient/follow_up.py"


# Of a cohort of files both registrations stand before any mesh: they check the files.
use rule follow_up as register_postop with:
    input:
        scan=INPUTS.patient.postop,
        # Of the scan that the skin is of too, where that is said.
        bones_of_postop=INPUTS.patient.bones_of_postop,
        labels=INPUTS.patient.labels_of_postop,
        skin="<results>/cases/{case}/skin.vtp",
        bone="<results>/cases/{case}/bone.vtp",
    output:
        postop=update("<results>/cases/{case}/postop.h5"),
    log:
        "<logs>/register_postop/{case}.log",
    benchmark:
        "<benchmarks>/register_postop/{case}.tsv"
    wildcard_constraints:
        case=REGISTERED,
    params:
        content=content(INPUTS.patient.postop, INPUTS.patient.bones_of_postop),
    message:
        "Register the post-operative skin of {wildcards.case}"


use rule follow_up as register_segments with:
    input:
        postop_bones=INPUTS.patient.postop_bones,
        labels="<results>/cases/{case}/labels.nii.gz",
        bone="<results>/cases/{case}/bone.vtp",
        plan="<results>/cases/{case}/plan.json",
    output:
        achieved=update("<results>/cases/{case}/achieved.json"),
        fits=ensure(update("<results>/cases/{case}/segments.csv"), non_empty=True),
    log:
        "<logs>/register_segments/{case}.log",
    benchmark:
        "<benchmarks>/register_segments/{case}.tsv"
    wildcard_constraints:
        case=REGISTERED,
    params:
        content=content(INPUTS.patient.postop_bones),
    message:
        "Register the bones of {wildcards.case} after surgery"


use rule follow_up as choose_samples with:
    input:
        model="<results>/cases/{case}/model.h5",
        motion=INPUTS.patient.motion,
        postop="<results>/cases/{case}/postop.h5",
    output:
        judged=update("<results>/cases/{case}/judged.h5"),
    log:
        "<logs>/choose_samples/{case}.log",
    benchmark:
        "<benchmarks>/choose_samples/{case}.tsv"
    wildcard_constraints:
        case=REGISTERED,
    message:
        "Choose where {wildcards.case} is judged"


use rule import_case as import_covariates with:
    input:
        described=INPUTS.patient.file("covariates_file"),
    output:
        covariates=update("<results>/{home}/{case}/covariates.json"),
    log:
        "<logs>/import_covariates/{home}/{case}.log",
    benchmark:
        "<benchmarks>/import_covariates/{home}/{case}.tsv"
    wildcard_constraints:
        home="patients",
    resources:
        mem_mb=500,
        runtime=5,
    params:
        content=content(INPUTS.patient.file("covariates_file")),
    message:
        "Write down what else is known of {wildcards.case}"


# Every file that a user gave has been read and checked before any heavy work starts.
rule check_cohort:
    input:
        folders=INPUTS.gathered.imported,
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
        "All files of the cohort are read and checked"
    script:
        "../scripts/patient/check_cohort.py"


# What comes of the labels, and the fields that networks are pretrained on, in one job; a killed one goes on at its stage.
rule model_case:
    input:
        labels="<results>/cases/{case}/labels.nii.gz",
        bone="<results>/cases/{case}/bone.vtp",
        skin="<results>/cases/{case}/skin.vtp",
        report="<results>/cases/{case}/import.json",
        plan="<results>/cases/{case}/plan.json",
        checked=ancient("<results>/cohort.csv"),
    output:
        **{name: update(file) for name, file in INPUTS.patient.to_train_on.items()},
        mesh=update("<results>/cases/{case}/mesh.vtu"),
        model=update("<results>/cases/{case}/model.h5"),
        quality=update("<results>/cases/{case}/quality.json"),
        lips_mesh=update("<results>/cases/{case}/lips/mesh.vtu"),
        lips_model=update("<results>/cases/{case}/lips/model.h5"),
    log:
        "<logs>/model_case/{case}.log",
    benchmark:
        "<benchmarks>/model_case/{case}.tsv"
    conda:
        "../envs/pinnochio.yaml"
    resources:
        mem_mb=megabytes(lambda _, files: 4000 + 60 * millions(files.labels)),
        runtime=120,
    params:
        nodes=config["mesh"]["nodes"],
        minimum_dihedral=config["mesh"]["minimum_dihedral"],
        interfaces=config["interfaces"],
        controls=config["lift"]["controls"],
        fem=config["fem"],
        lip_edge=config["fem_rlse"]["lip_edge"],
        plans=config["fem_samples"]["plans"],
        seed=SEED,
        code=code_of("scripts.patient.model_patient"),
    message:
        "Mesh and label {wildcards.case}"
    script:
        "../scripts/patient/model_patient.py"


# Of a new patient no plan is solved yet.
use rule model_case as model_patient with:
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
    wildcard_constraints:
        home="patients",
    params:
        nodes=INPUTS.patient.nodes,
        minimum_dihedral=INPUTS.patient.setting("mesh", "minimum_dihedral"),
        interfaces=INPUTS.patient.setting("interfaces"),
        controls=INPUTS.patient.setting("lift", "controls"),
        fem=INPUTS.patient.setting("fem"),


# On another mesh than the study's.
use rule model_patient as model_sized with:
    output:
        mesh=update("<results>/{home}/{case}/nodes_{nodes}/mesh.vtu"),
        model=update("<results>/{home}/{case}/nodes_{nodes}/model.h5"),
    log:
        "<logs>/model_sized/{home}/{case}_{nodes}.log",
    benchmark:
        "<benchmarks>/model_sized/{home}/{case}_{nodes}.tsv"
    wildcard_constraints:
        home=STUDY.wildcards["home"],
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


ruleorder: model_case > make_lift
ruleorder: model_patient > make_lift


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
