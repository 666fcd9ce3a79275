rule virtual_patient:
    output:
        segmentation="<results>/virtual/{case}/segmentation.nii.gz",
        plan="<results>/virtual/{case}/plan.json",
        landmarks="<results>/virtual/{case}/landmarks.json",
    log:
        "<logs>/virtual_patient/{case}.log",
    benchmark:
        "<benchmarks>/virtual_patient/{case}.tsv"
    conda:
        "../envs/pinnochio.yaml"
    threads: 1
    resources:
        mem_mb=4000,
        runtime=10,
    params:
        number=lambda wildcards: list(CASES).index(wildcards.case),
        spacing=config["virtual"]["spacing"],
        labels=config["labels"],
        seed=SEED,
        code=code_of("anatomy", "virtual"),
    message:
        "Sample virtual patient {wildcards.case}"
    script:
        "../scripts/virtual_patient.py"


rule virtual_outcome:
    input:
        segmentation="<results>/virtual/{case}/segmentation.nii.gz",
        plan="<results>/virtual/{case}/plan.json",
        landmarks="<results>/virtual/{case}/landmarks.json",
    output:
        postop="<results>/virtual/{case}/postop.ply",
        truth="<results>/virtual/{case}/truth.h5",
    log:
        "<logs>/virtual_outcome/{case}.log",
    benchmark:
        "<benchmarks>/virtual_outcome/{case}.tsv"
    conda:
        "../envs/pinnochio.yaml"
    threads: 1
    resources:
        mem_mb=6000,
        runtime=30,
    params:
        reality=config["virtual"]["reality"],
        noise=config["virtual"]["scan"]["noise"],
        bone_edge=config["mesh"]["bone_edge"],
        interfaces=config["interfaces"],
        fem=config["fem"],
        segments=config["segments"],
        labels=config["labels"],
        seed=SEED,
        code=code_of("anatomy", "virtual", "meshing", "mechanics"),
    message:
        "Operate on virtual patient {wildcards.case} and scan the face"
    script:
        "../scripts/virtual_outcome.py"


rule cohort:
    input:
        expand(
            "<results>/virtual/{case}/{file}",
            case=CASES,
            file=["postop.ply", "truth.h5"],
        )
        if VIRTUAL
        else [],
    message:
        "The virtual cohort is made"
