rule virtual_patient:
    output:
        segmentation="<results>/virtual/{case}/segmentation.nii.gz",
        plan="<results>/virtual/{case}/plan.json",
        landmarks="<results>/virtual/{case}/landmarks.json",
        anatomy="<results>/virtual/{case}/anatomy.json",
        covariates="<results>/virtual/{case}/covariates.json",
    log:
        "<logs>/virtual_patient/{case}.log",
    benchmark:
        "<benchmarks>/virtual_patient/{case}.tsv"
    conda:
        "../envs/pinnochio.yaml"
    resources:
        mem_mb=megabytes(4000),
        runtime=10,
    params:
        number=lambda wildcards: INPUTS.cohort.drawn[wildcards.case]["number"],
        spacing=config["virtual"]["spacing"],
        labels=INPUTS.cohort.label_values,
        procedure=lambda wildcards: INPUTS.cohort.drawn[wildcards.case]["procedure"],
        reality=config["virtual"]["outcome"]["reality"],
        seed=SEED,
        code=code_of("scripts.cohort.virtual_patient"),
    message:
        "Sample virtual patient {wildcards.case}"
    script:
        "../scripts/cohort/virtual_patient.py"


# Contact sheet of the first patients, to be looked at: face, skull and outcome.
rule render_faces:
    input:
        models=expand(
            "<results>/cases/{case}/model.h5", case=list(STUDY.cohort.cases)[:24]
        ),
        motions=expand(
            "<results>/cases/{case}/true_motion.h5", case=list(STUDY.cohort.cases)[:24]
        ),
        anatomies=expand(
            "<results>/virtual/{case}/anatomy.json", case=list(STUDY.cohort.cases)[:24]
        ),
    output:
        sheet="<results>/figures/faces.png",
    log:
        "<logs>/render_faces.log",
    benchmark:
        "<benchmarks>/render_faces.tsv"
    conda:
        "../envs/pinnochio.yaml"
    resources:
        mem_mb=4000,
        runtime=20,
    params:
        cases=list(STUDY.cohort.cases)[:24],
        code=code_of("scripts.cohort.render_faces"),
    message:
        "Render the faces of the first virtual patients"
    script:
        "../scripts/cohort/render_faces.py"


# The face after surgery, then the segmented bones of a second scan; the truth of the motion stays with the outcome.
rule virtual_outcome:
    input:
        segmentation="<results>/virtual/{case}/segmentation.nii.gz",
        plan="<results>/virtual/{case}/plan.json",
        landmarks="<results>/virtual/{case}/landmarks.json",
        anatomy="<results>/virtual/{case}/anatomy.json",
        covariates="<results>/virtual/{case}/covariates.json",
    output:
        postop=update("<results>/virtual/{case}/postop.ply"),
        truth=update("<results>/virtual/{case}/truth.h5"),
        executed=update("<results>/virtual/{case}/executed.json"),
        bones=update("<results>/virtual/{case}/postop_bones.nii.gz"),
    log:
        "<logs>/virtual_outcome/{case}.log",
    benchmark:
        "<benchmarks>/virtual_outcome/{case}.tsv"
    conda:
        "../envs/pinnochio.yaml"
    resources:
        mem_mb=megabytes(INPUTS.cohort.memory),
        runtime=30,
    params:
        outcome=config["virtual"]["outcome"],
        artefacts=config["virtual"]["bone_scan"],
        segments=config["segments"],
        labels=INPUTS.cohort.label_values,
        seed=SEED,
        code=code_of("scripts.cohort.operate_and_scan"),
    message:
        "Operate on virtual patient {wildcards.case}, and scan face and bones"
    script:
        "../scripts/cohort/operate_and_scan.py"


# What stands beside the cohort for those who take it elsewhere.
rule data_card:
    input:
        files=INPUTS.cohort.files("anatomy.json", "covariates.json", "plan.json"),
    output:
        card="<results>/virtual/README.md",
    log:
        "<logs>/data_card.log",
    conda:
        "../envs/pinnochio.yaml"
    resources:
        mem_mb=1000,
        runtime=10,
    params:
        cases=list(STUDY.cohort.cases),
        settings={
            "seed": SEED,
            "code": code_of(
                "scripts.cohort.virtual_patient",
                "scripts.cohort.operate_and_scan",
            ),
            "virtual": config["virtual"],
            "labels": {
                name: value
                for name, value in INPUTS.cohort.label_values.items()
                if name in ("superficial", "muscle", "cranium", *config["segments"])
            },
        },
        code=code_of("scripts.cohort.data_card"),
    message:
        "Describe the virtual cohort"
    script:
        "../scripts/cohort/data_card.py"


# Of a locked cohort the outcomes are summed up apart.
rule sum_up:
    input:
        files=INPUTS.cohort.summed_up,
    output:
        checksums="<results>/virtual/{sums}",
    log:
        "<logs>/sum_up/{sums}.log",
    wildcard_constraints:
        sums=r"SHA256SUMS(\.outcomes)?",
    conda:
        "../envs/pinnochio.yaml"
    resources:
        mem_mb=1000,
        runtime=10,
    params:
        code=code_of("scripts.cohort.sum_up"),
    message:
        "Sum up files of the virtual cohort: {wildcards.sums}"
    script:
        "../scripts/cohort/sum_up.py"


rule cohort:
    input:
        rules.data_card.output if STUDY.cohort.virtual else [],
        "<results>/virtual/SHA256SUMS" if STUDY.cohort.virtual else [],
        table_and_twins("anatomy", folder="virtual") if STUDY.cohort.virtual else [],
    message:
        "The virtual cohort is made"


rule reveal:
    input:
        "<results>/virtual/SHA256SUMS.outcomes" if STUDY.cohort.locked else [],
    message:
        "The outcomes of the locked cohort are made"
