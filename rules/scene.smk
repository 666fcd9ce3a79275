# Models reduced to what a plan requires: those of the study, where `scene.mode` is auto, and what each reduction costs.


rule make_scene:
    input:
        model="<results>/cases/{case}/model.h5",
        labels="<results>/cases/{case}/labels.nii.gz",
        skin="<results>/cases/{case}/skin.vtp",
        plan=STUDY.motion,
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
        settings=STUDY.reduction,
        code=code_of("make_scene"),
    message:
        "Decide what the plan of {wildcards.case} requires"
    script:
        "../scripts/make_scene.py"


rule measure_scene:
    input:
        labels="<results>/cases/{case}/labels.nii.gz",
        bone="<results>/cases/{case}/bone.vtp",
        skin="<results>/cases/{case}/skin.vtp",
        plan="<results>/cases/{case}/plan.json",
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
        mesh=config["mesh"],
        interfaces=config["interfaces"],
        fem=config["fem"],
        settings=STUDY.reduction,
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
