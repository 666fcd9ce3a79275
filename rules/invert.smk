# From a wished face to a plan; not part of `all`.


rule propose:
    input:
        model="<results>/{home}/{case}/model.h5",
        wish=STUDY.wish,
        markups=STUDY.markups,
        occlusion=STUDY.occlusion,
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


rule invert:
    input:
        STUDY.proposals_of_patients,
    message:
        "The wishes are answered: see {config[pathvars][results]}/patients"
