rule make_lift:
    input:
        model="<results>/cases/{case}/model.h5",
    output:
        lift="<results>/cases/{case}/lift_{kind}.h5",
    log:
        "<logs>/make_lift/{case}_{kind}.log",
    benchmark:
        "<benchmarks>/make_lift/{case}_{kind}.tsv"
    wildcard_constraints:
        kind="harmonic|elastic",
    conda:
        "../envs/pinnochio.yaml"
    threads: 1
    resources:
        mem_mb=4000,
        runtime=30,
    params:
        controls=config["lift"]["controls"],
        fem=config["fem"],
        code=code_of("make_lift"),
    message:
        "Make the {wildcards.kind} lift of {wildcards.case}"
    script:
        "../scripts/make_lift.py"
