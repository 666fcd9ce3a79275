# What every method does at the extremes, family by family; wrong cells stand in the table, and fail the target.

from functools import cache

from pinnochio.study.choice import choose
from studies.stability.inputs import parts
from studies.stability.table import OF_PATIENTS

EXTREMES = parts(config["stability"], list(STUDY.cohort.cases))
add_table(
    "stability",
    "studies.stability.table",
    title="Stability at the extremes",
    caption="What the mechanics does at the extremes: each cell converged, failed cleanly, or is wrong.",
    figure="studies.stability.figure",
    files={"parts": expand("<results>/stability/{part}.csv", part=EXTREMES)},
    arguments={},
)


predicting = cache(lambda: choose(config, STUDY.models))  # read where it is asked for


rule measure_stability:
    input:
        # Of the block there is none.
        model=lambda wildcards: expand(
            STUDY.sized(config["stability"]["nodes"], "model.h5"),
            case={EXTREMES[wildcards.part]["case"]} - {"block"},
        ),
        # The first of the archive's.
        network=lambda wildcards: (
            predicting().networks[:1]
            if EXTREMES[wildcards.part]["family"] in OF_PATIENTS
            else []
        ),
    output:
        table=ensure("<results>/stability/{part}.csv", non_empty=True),
    log:
        "<logs>/measure_stability/{part}.log",
    benchmark:
        "<benchmarks>/measure_stability/{part}.tsv"
    wildcard_constraints:
        part=any_of(EXTREMES),
    conda:
        "../../../envs/pinnochio.yaml"
    resources:
        mem_mb=8000,
        runtime=60,
    params:
        family=lambda wildcards: EXTREMES[wildcards.part]["family"],
        case=lambda wildcards: EXTREMES[wildcards.part]["case"],
        way=lambda wildcards: EXTREMES[wildcards.part]["way"],
        stability=config["stability"],
        fem=config["fem"],
        seed=SEED,
        controls=config["lift"]["controls"],
        corrections=lambda _, input: predicting().corrections if input.network else 0,
        code=code_of("studies.stability.measure_stability"),
    message:
        "Take every method to its extremes: {wildcards.part}"
    script:
        "measure_stability.py"


# After table and figure are there: fails, and names the cells, where one is wrong and nothing says so to a user.
rule check_stability:
    input:
        recorded("stability"),
        "<results>/figures/stability.png",
        table="<results>/tables/stability.csv",
    output:
        verdict="<results>/stability/verdict.txt",
    log:
        "<logs>/check_stability.log",
    conda:
        "../../../envs/pinnochio.yaml"
    resources:
        mem_mb=500,
        runtime=5,
    params:
        code=code_of("studies.stability.check_stability"),
    message:
        "Ask whether a cell is wrong"
    script:
        "check_stability.py"


rule stability:
    input:
        "<results>/stability/verdict.txt",
    message:
        "The extremes are measured"
