# How well the motion is found that made a face; not part of `all`.


rule measure_inverse:
    input:
        model="<results>/cases/{case}/model.h5",
        plan="<results>/cases/{case}/plan.json",
        achieved=STUDY.after_surgery("<results>/cases/{case}/achieved.json"),
        postop=STUDY.after_surgery("<results>/cases/{case}/postop.h5"),
        truth=(
            STUDY.after_surgery("<results>/virtual/{case}/truth.h5")
            if STUDY.virtual
            else []
        ),
    output:
        recovered=ensure("<results>/inverse/{case}/recovered.csv", non_empty=True),
        faces="<results>/inverse/{case}/faces.csv",
        marked="<results>/inverse/{case}/marked.csv",
        seen="<results>/inverse/{case}/seen.csv",
    log:
        "<logs>/measure_inverse/{case}.log",
    benchmark:
        "<benchmarks>/measure_inverse/{case}.tsv"
    conda:
        "../../../envs/pinnochio.yaml"
    resources:
        mem_mb=4000,
        runtime=30,
    params:
        fem=config["fem"],
        settings=config["invert"],
        seed=SEED,
        code=code_of("studies.inverse.measure_inverse"),
    message:
        "Measure on {wildcards.case} how well the motion is found that made a face"
    script:
        "measure_inverse.py"


rule inverse:
    input:
        recorded("inverse"),
    message:
        "It is measured how well the motion is found that made a face"
