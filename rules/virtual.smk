rule virtual_patient:
    output:
        segmentation="<results>/virtual/{case}/segmentation.nii.gz",
        plan="<results>/virtual/{case}/plan.json",
        landmarks="<results>/virtual/{case}/landmarks.json",
        anatomy="<results>/virtual/{case}/anatomy.json",
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
        number=lambda wildcards: list(STUDY.cases).index(wildcards.case),
        spacing=config["virtual"]["spacing"],
        labels=config["labels"],
        procedure=lambda wildcards: vars(STUDY.procedures[wildcards.case]),
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
        files=STUDY.virtual_files("anatomy.json", "plan.json"),
        tables=expand("<results>/virtual/{table}.md", table=STUDY.card_tables),
    output:
        card="<results>/virtual/README.md",
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
        "Describe the virtual cohort"
    script:
        "../scripts/data_card.py"


# Of a locked cohort the outcomes are summed up apart.
rule sum_up:
    input:
        files=STUDY.summed_up,
    output:
        checksums="<results>/virtual/{sums}",
    log:
        "<logs>/sum_up/{sums}.log",
    wildcard_constraints:
        sums=r"SHA256SUMS(\.outcomes)?",
    conda:
        "../envs/pinnochio.yaml"
    threads: 1
    resources:
        mem_mb=1000,
        runtime=10,
    params:
        code=code_of("sum_up"),
    message:
        "Sum up files of the virtual cohort: {wildcards.sums}"
    script:
        "../scripts/sum_up.py"


rule cohort:
    input:
        rules.data_card.output if STUDY.virtual else [],
        "<results>/virtual/SHA256SUMS" if STUDY.virtual else [],
        expand(
            "<results>/virtual/{table}.{kind}",
            table=["anatomy", *STUDY.card_tables] if STUDY.virtual else [],
            kind=["csv", *TWINS],
        ),
    message:
        "The virtual cohort is made"


rule reveal:
    input:
        "<results>/virtual/SHA256SUMS.outcomes" if STUDY.locked else [],
        expand(
            "<results>/virtual/ratios.{kind}",
            kind=["csv", *TWINS] if STUDY.locked else [],
        ),
    message:
        "The outcomes of the locked cohort are made"


# Whether the cohort as it is made here is the one that was frozen; its outcomes too, once they are revealed.
rule verify_cohort:
    input:
        made=expand("<results>/virtual/{sums}", sums=STUDY.sums),
        frozen=f"results/reference/SHA256SUMS.{config['virtual']['role']}",
    output:
        table=ensure("<results>/virtual/verified.csv", non_empty=True),
    log:
        "<logs>/verify_cohort.log",
    conda:
        "../envs/pinnochio.yaml"
    threads: 1
    resources:
        mem_mb=500,
        runtime=5,
    params:
        code=code_of("verify_cohort"),
    message:
        "Compare the virtual cohort with its frozen checksums"
    script:
        "../scripts/verify_cohort.py"


rule verify:
    input:
        rules.verify_cohort.output,
    message:
        "The virtual cohort is the one that was frozen"
