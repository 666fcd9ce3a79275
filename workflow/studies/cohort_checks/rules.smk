# What checks the virtual cohort beyond making it; not part of `all`.

TRUTH = {"truth": "<results>/virtual/{case}/truth.h5"}
FIRST = {"template": f"<results>/cases/{next(iter(STUDY.cohort.cases), '')}/model.h5"}
# What the modules about the outcome measure on one patient, each for the table of its name: further inputs and arguments.
MEASURED = {
    "structure": (TRUTH | FIRST, {}),
    "reality": (
        {},
        {
            "effects": config["virtual"]["outcome"]["effects"],
            "samples": config["evaluation"]["samples"],
        },
    ),
    "refinement": ({}, {}),
}
add_table(
    "reality",
    "studies.cohort_checks.reality",
    caption="Dials of the outcome, and sliding finite elements there beside the literature.",
    files={
        "rows": expand("<results>/virtual/{case}/reality.csv", case=STUDY.cohort.cases)
    },
    arguments=NAMED,
)
add_table(
    "structure",
    "studies.cohort_checks.structure",
    caption=(
        "Structure of what finite elements miss of the outcome, beside three operated "
        "patients, and the share that is decided."
    ),
    files={
        "rows": expand(
            "<results>/virtual/{case}/structure.csv", case=STUDY.cohort.cases
        )
    },
    arguments=NAMED,
)
add_table(
    "refinement",
    "studies.cohort_checks.refinement",
    caption="Discretisation error of the outcome beside that of the methods' mesh.",
    files={
        "rows": expand(
            "<results>/virtual/{case}/refinement.csv",
            case=list(STUDY.cohort.cases)[: config["virtual"]["refinement"]],
        )
    },
    arguments=NAMED,
)


add_table(
    "thickness",
    "studies.cohort_checks.thickness",
    caption="Thickness of the soft tissue over bone, beside the literature.",
    files=ANATOMIES,
    arguments=NAMED,
)
add_table(
    "ratios",
    "studies.cohort_checks.ratios",
    caption="How far the outcomes' skin follows the bone, beside the literature.",
    files={
        "landmarks": expand(
            "<results>/virtual/{case}/landmarks.json", case=STUDY.cohort.cases
        ),
        "truths": expand("<results>/virtual/{case}/truth.h5", case=STUDY.cohort.cases),
    },
    arguments=NAMED | {"cases": list(STUDY.cohort.cases)},
)


rule measure_outcome:
    input:
        unpack(lambda wildcards: MEASURED[wildcards.measured][0]),
        segmentation="<results>/virtual/{case}/segmentation.nii.gz",
        plan="<results>/virtual/{case}/plan.json",
        landmarks="<results>/virtual/{case}/landmarks.json",
        anatomy="<results>/virtual/{case}/anatomy.json",
        covariates="<results>/virtual/{case}/covariates.json",
    output:
        table=ensure("<results>/virtual/{case}/{measured}.csv", non_empty=True),
    log:
        "<logs>/measure_outcome/{measured}_{case}.log",
    benchmark:
        "<benchmarks>/measure_outcome/{measured}_{case}.tsv"
    wildcard_constraints:
        measured=any_of(MEASURED),
    conda:
        "../../../envs/pinnochio.yaml"
    resources:
        mem_mb=lambda wildcards: 12000 if wildcards.measured == "refinement" else 6000,
        runtime=120,
    params:
        module=lambda wildcards: MODULES[wildcards.measured],
        arguments=lambda wildcards: MEASURED[wildcards.measured][1],
        outcome=config["virtual"]["outcome"],
        segments=config["segments"],
        labels=INPUTS.cohort.label_values,
        seed=SEED,
        code=lambda wildcards: code_of(
            "studies.cohort_checks.measure_outcome", MODULES[wildcards.measured]
        ),
    message:
        "Measure {wildcards.measured} of the outcome on {wildcards.case}"
    script:
        "measure_outcome.py"


# Whether the cohort as it is made here is the one that was frozen; its outcomes too, once they are revealed.
rule verify_cohort:
    input:
        made=expand("<results>/virtual/{sums}", sums=INPUTS.cohort.sums),
        frozen=f"results/reference/SHA256SUMS.{config['virtual']['role']}",
    output:
        table=ensure("<results>/virtual/verified.csv", non_empty=True),
    log:
        "<logs>/verify_cohort.log",
    conda:
        "../../../envs/pinnochio.yaml"
    resources:
        mem_mb=500,
        runtime=5,
    params:
        code=code_of("studies.cohort_checks.verify_cohort"),
    message:
        "Compare the virtual cohort with its frozen checksums"
    script:
        "verify_cohort.py"


rule verify:
    input:
        rules.verify_cohort.output,
    message:
        "The virtual cohort is the one that was frozen"


# Further tables about the outcome: of calibration patients, of all patients, of the first ones.
rule reality:
    input:
        recorded("reality", "virtual"),
    message:
        "The dials of the outcome are found: results/calibration/virtual/reality.md"


rule structure:
    input:
        recorded("structure", "virtual"),
    message:
        "The structure of the outcome is measured"


rule refinement:
    input:
        recorded("refinement", "virtual"),
    message:
        "The discretisation error of the outcome is measured"


rule soft_tissue:
    input:
        recorded("thickness", "virtual"),
        recorded("ratios", "virtual"),
    message:
        "Thickness and ratios of the soft tissue are measured"
