# Models reduced to what a plan requires: those of the study, where `scene.mode` is auto, and what each reduction costs.


rule make_scene:
    input:
        model="<results>/cases/{case}/model.h5",
        labels="<results>/cases/{case}/labels.nii.gz",
        skin="<results>/cases/{case}/skin.vtp",
        plan="<results>/cases/{case}/plan.json",
    output:
        scene="<results>/cases/{case}/scene/scene.json",
        model="<results>/cases/{case}/scene/model.h5",
    log:
        "<logs>/make_scene/{case}.log",
    benchmark:
        "<benchmarks>/make_scene/{case}.tsv"
    conda:
        "../envs/pinnochio.yaml"
    threads: 1
    resources:
        mem_mb=4000,
        runtime=10,
    params:
        interfaces=config["interfaces"],
        fem=config["fem"],
        settings=SCENE,
        code=code_of("make_scene"),
    message:
        "Decide what the plan of {wildcards.case} requires"
    script:
        "../scripts/make_scene.py"


# The same heads as in the cohort, with the chin cut off as a further segment.
use rule virtual_patient as virtual_patient_with_chin with:
    output:
        segmentation="<results>/scene/{case}/segmentation.nii.gz",
        plan="<results>/scene/{case}/given.json",
        landmarks="<results>/scene/{case}/landmarks.json",
        anatomy="<results>/scene/{case}/anatomy.json",
    log:
        "<logs>/virtual_patient_with_chin/{case}.log",
    benchmark:
        "<benchmarks>/virtual_patient_with_chin/{case}.tsv"
    params:
        number=lambda wildcards: list(CASES).index(wildcards.case),
        spacing=config["virtual"]["spacing"],
        labels=config["labels"],
        segments=SCENE_SEGMENTS,
        muscles=config["virtual"]["muscles"],
        seed=SEED,
        code=code_of("virtual_patient"),
    message:
        "Sample virtual patient {wildcards.case} with a chin segment"


use rule import_segmentation as import_with_chin with:
    input:
        segmentation="<results>/scene/{case}/segmentation.nii.gz",
        plan="<results>/scene/{case}/given.json",
    output:
        labels="<results>/scene/{case}/labels.nii.gz",
        bone="<results>/scene/{case}/bone.vtp",
        skin="<results>/scene/{case}/skin.vtp",
        plan="<results>/scene/{case}/plan.json",
        report="<results>/scene/{case}/import.json",
    log:
        "<logs>/import_with_chin/{case}.log",
    benchmark:
        "<benchmarks>/import_with_chin/{case}.tsv"
    params:
        labels=config["labels"],
        segments=SCENE_SEGMENTS,
        orientation="header",
        repair=config["repair"],
        unlabelled_muscle=config["unlabelled_muscle"],
        bone_edge=config["mesh"]["bone_edge"],
        code=code_of("import_segmentation"),
    message:
        "Import {wildcards.case} with a chin segment"


rule measure_scene:
    input:
        labels=f"<results>/{SCENE_FOLDER}/{{case}}/labels.nii.gz",
        bone=f"<results>/{SCENE_FOLDER}/{{case}}/bone.vtp",
        skin=f"<results>/{SCENE_FOLDER}/{{case}}/skin.vtp",
        plan=f"<results>/{SCENE_FOLDER}/{{case}}/plan.json",
    output:
        table=ensure("<results>/scene/{case}/trials.csv", non_empty=True),
        scene="<results>/scene/{case}/scene.json",
    log:
        "<logs>/measure_scene/{case}.log",
    benchmark:
        "<benchmarks>/measure_scene/{case}.tsv"
    conda:
        "../envs/pinnochio.yaml"
    threads: 1
    resources:
        mem_mb=4000,
        runtime=60,
    params:
        segments=SCENE_SEGMENTS,
        mesh=config["mesh"],
        interfaces=config["interfaces"],
        fem=config["fem"],
        settings=SCENE,
        seed=SEED,
        code=code_of("measure_scene"),
    message:
        "Measure what each reduction of the model of {wildcards.case} costs"
    script:
        "../scripts/measure_scene.py"


rule scene:
    input:
        table_and_twins("scene"),
    message:
        "What a plan requires of a model is measured"
