# The cohort, and the same heads with the chin cut off as a further segment (virtual_chin).
rule virtual_patient:
    output:
        segmentation="<results>/{cohort}/{case}/segmentation.nii.gz",
        plan="<results>/{cohort}/{case}/plan.json",
        landmarks="<results>/{cohort}/{case}/landmarks.json",
        anatomy="<results>/{cohort}/{case}/anatomy.json",
    log:
        "<logs>/virtual_patient/{cohort}/{case}.log",
    benchmark:
        "<benchmarks>/virtual_patient/{cohort}/{case}.tsv"
    wildcard_constraints:
        cohort="virtual|virtual_chin",
    conda:
        "../envs/pinnochio.yaml"
    threads: 1
    resources:
        mem_mb=4000,
        runtime=10,
    params:
        number=lambda wildcards: list(STUDY.cases).index(wildcards.case),
        anatomy=config["virtual"]["anatomy"],
        spacing=config["virtual"]["spacing"],
        labels=config["labels"],
        segments=lambda wildcards: (
            STUDY.all_segments
            if wildcards.cohort == "virtual_chin"
            else config["segments"]
        ),
        muscles=config["virtual"]["muscles"],
        seed=SEED,
        code=code_of("virtual_patient"),
    message:
        "Sample virtual patient {wildcards.case}"
    script:
        "../scripts/virtual_patient.py"


# The first patients of the cohort, as many as a page shows.
rule render_cohort:
    input:
        segmentations=expand(
            "<results>/virtual/{case}/segmentation.nii.gz", case=list(STUDY.cases)[:12]
        ),
        anatomies=expand(
            "<results>/virtual/{case}/anatomy.json", case=list(STUDY.cases)[:12]
        ),
    output:
        cohort="<results>/figures/cohort.png",
        heads="<results>/figures/heads.png",
    log:
        "<logs>/render_cohort.log",
    benchmark:
        "<benchmarks>/render_cohort.tsv"
    conda:
        "../envs/pinnochio.yaml"
    threads: 1
    resources:
        mem_mb=4000,
        runtime=10,
    params:
        cases=list(STUDY.cases)[:12],
        labels=config["labels"],
        segments=config["segments"],
        code=code_of("render_cohort"),
    message:
        "Render the first virtual patients"
    script:
        "../scripts/render_cohort.py"


# Contact sheet of the first patients, to be looked at: face, skull and outcome.
rule render_faces:
    input:
        segmentations=expand(
            "<results>/virtual/{case}/segmentation.nii.gz", case=list(STUDY.cases)[:24]
        ),
        anatomies=expand(
            "<results>/virtual/{case}/anatomy.json", case=list(STUDY.cases)[:24]
        ),
        truths=expand("<results>/virtual/{case}/truth.h5", case=list(STUDY.cases)[:24]),
    output:
        sheet="<results>/figures/faces.png",
    log:
        "<logs>/render_faces.log",
    benchmark:
        "<benchmarks>/render_faces.tsv"
    conda:
        "../envs/pinnochio.yaml"
    threads: 1
    resources:
        mem_mb=4000,
        runtime=20,
    params:
        cases=list(STUDY.cases)[:24],
        labels=config["labels"],
        segments=config["segments"],
        code=code_of("render_faces"),
    message:
        "Render the faces of the first virtual patients"
    script:
        "../scripts/render_faces.py"


rule virtual_outcome:
    input:
        segmentation="<results>/virtual/{case}/segmentation.nii.gz",
        plan="<results>/virtual/{case}/plan.json",
        landmarks="<results>/virtual/{case}/landmarks.json",
    output:
        postop="<results>/virtual/{case}/postop.ply",
        truth="<results>/virtual/{case}/truth.h5",
        executed="<results>/virtual/{case}/executed.json",
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
        outcome=config["virtual"]["outcome"],
        segments=config["segments"],
        labels=config["labels"],
        seed=SEED,
        code=code_of("virtual_outcome"),
    message:
        "Operate on virtual patient {wildcards.case} and scan the face"
    script:
        "../scripts/virtual_outcome.py"


rule measure_effects:
    input:
        segmentation="<results>/virtual/{case}/segmentation.nii.gz",
        plan="<results>/virtual/{case}/plan.json",
        landmarks="<results>/virtual/{case}/landmarks.json",
        truth="<results>/virtual/{case}/truth.h5",
    output:
        table=ensure("<results>/virtual/{case}/effects.csv", non_empty=True),
    log:
        "<logs>/measure_effects/{case}.log",
    benchmark:
        "<benchmarks>/measure_effects/{case}.tsv"
    conda:
        "../envs/pinnochio.yaml"
    threads: 1
    resources:
        mem_mb=6000,
        runtime=60,
    params:
        outcome=config["virtual"]["outcome"],
        segments=config["segments"],
        labels=config["labels"],
        seed=SEED,
        code=code_of("measure_effects"),
    message:
        "Measure each effect of the outcome alone on {wildcards.case}"
    script:
        "../scripts/measure_effects.py"


# What stands beside the cohort for those who take it elsewhere.
rule data_card:
    input:
        files=expand(
            "<results>/virtual/{case}/{file}",
            case=STUDY.cases,
            file=[
                "segmentation.nii.gz",
                "plan.json",
                "landmarks.json",
                "anatomy.json",
                "postop.ply",
                "truth.h5",
                "executed.json",
            ],
        ),
        tables=expand("<results>/virtual/{table}.md", table=STUDY.card_tables),
    output:
        card="<results>/virtual/README.md",
        checksums="<results>/virtual/SHA256SUMS",
    log:
        "<logs>/data_card.log",
    conda:
        "../envs/pinnochio.yaml"
    threads: 1
    resources:
        mem_mb=1000,
        runtime=10,
    params:
        cases=list(STUDY.cases),
        tables=STUDY.card_tables,
        settings={
            "seed": SEED,
            "code": code_of("virtual_patient", "virtual_outcome"),
            "virtual": config["virtual"],
            "labels": {
                name: value
                for name, value in config["labels"].items()
                if name in ("superficial", "muscle", "cranium", *config["segments"])
            },
        },
        code=code_of("data_card"),
    message:
        "Describe the virtual cohort and sum up its files"
    script:
        "../scripts/data_card.py"


rule cohort:
    input:
        rules.data_card.output if STUDY.virtual else [],
        expand(
            "<results>/virtual/{table}.{kind}",
            table=["anatomy", *STUDY.card_tables] if STUDY.virtual else [],
            kind=["csv", *TWINS],
        ),
    message:
        "The virtual cohort is made"
