# What solving only what a plan requires saves.


rule measure_scene:
    input:
        labels="<results>/cases/{case}/labels.nii.gz",
        bone="<results>/cases/{case}/bone.vtp",
        skin="<results>/cases/{case}/skin.vtp",
        plan="<results>/cases/{case}/plan.json",
    output:
        table=ensure("<results>/scene/{case}/trials.csv", non_empty=True),
    log:
        "<logs>/measure_scene/{case}.log",
    benchmark:
        "<benchmarks>/measure_scene/{case}.tsv"
    conda:
        "../../../envs/pinnochio.yaml"
    resources:
        mem_mb=4000,
        runtime=60,
    params:
        config={
            name: config[name] for name in ("mesh", "interfaces", "fem_rlse", "scene")
        },
        methods=STUDY.reduced_methods,
        seed=SEED,
        code=code_of("studies.scene.measure_scene"),
    message:
        "Measure what solving only what a plan of {wildcards.case} requires saves"
    script:
        "measure_scene.py"


rule scene:
    input:
        recorded("scene"),
    message:
        "What solving only what a plan requires saves is measured"
