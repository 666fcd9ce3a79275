# From a wished face to a plan; not part of `all`.


rule propose:
    input:
        model="<results>/{home}/{case}/model.h5",
        wish=STUDY.wish,
        markups=STUDY.markups,
        occlusion=STUDY.occlusion,
        calibration=STUDY.calibration_of_wishes,
    output:
        proposals=ensure("<results>/{home}/{case}/invert/proposals.csv", non_empty=True),
        reached="<results>/{home}/{case}/invert/reached.csv",
        motions="<results>/{home}/{case}/invert/motions.csv",
        combinations="<results>/{home}/{case}/invert/combinations.csv",
        # One per operation that the patient's segments allow.
        plans=directory("<results>/{home}/{case}/invert/plans"),
        transforms=directory("<results>/{home}/{case}/invert/transforms"),
        page="<results>/{home}/{case}/invert/index.html",
    log:
        "<logs>/propose/{home}/{case}.log",
    benchmark:
        "<benchmarks>/propose/{home}/{case}.tsv"
    wildcard_constraints:
        home="patients",
    conda:
        "../envs/pinnochio.yaml"
    threads: 1
    resources:
        mem_mb=4000,
        runtime=30,
    params:
        fem=STUDY.of_patient("fem"),
        settings=config["invert"],
        code=code_of("propose"),
    message:
        "Seek plans that bring {wildcards.case} to the wished face"
    script:
        "../scripts/propose.py"


# Of every patient, new or of the study: which move of which bone moves which place of the face.
rule measure_sensitivity:
    input:
        model="<results>/{home}/{case}/model.h5",
    output:
        table=ensure("<results>/{home}/{case}/sensitivity.csv", non_empty=True),
        picture="<results>/{home}/{case}/sensitivity.png",
    log:
        "<logs>/measure_sensitivity/{home}/{case}.log",
    benchmark:
        "<benchmarks>/measure_sensitivity/{home}/{case}.tsv"
    conda:
        "../envs/pinnochio.yaml"
    threads: 1
    resources:
        mem_mb=4000,
        runtime=10,
    params:
        fem=STUDY.of_patient("fem"),
        code=code_of("measure_sensitivity"),
    message:
        "Measure which move matters where on the face of {wildcards.case}"
    script:
        "../scripts/measure_sensitivity.py"


rule invert:
    input:
        STUDY.proposals_of_patients,
    message:
        "The wishes are answered: see {config[pathvars][results]}/patients"


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
        "../envs/pinnochio.yaml"
    threads: 1
    resources:
        mem_mb=4000,
        runtime=30,
    params:
        fem=config["fem"],
        settings=config["invert"],
        seed=SEED,
        code=code_of("measure_inverse"),
    message:
        "Measure on {wildcards.case} how well the motion is found that made a face"
    script:
        "../scripts/measure_inverse.py"


rule inverse:
    input:
        recorded("inverse"),
    message:
        "It is measured how well the motion is found that made a face"
