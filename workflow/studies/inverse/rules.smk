# How well the motion is found that made a face; not part of `all`.

INVERTED = list(STUDY.cohort.cases)[: config["invert"]["patients"]]
# Patients of whom scan and bones after surgery are there.
OUTCOMES = [name for name in STUDY.cohort.registered if name in STUDY.cohort.scanned]
add_table(
    "inverse",
    "studies.inverse.table",
    caption="How well the motion of the bones is found that made a face, against an inverse regression, and which landmarks of an outcome are reached.",
    files={
        kind: expand(f"<results>/inverse/{{case}}/{kind}.csv", case=INVERTED)
        for kind in ("recovered", "faces", "marked", "seen")
    }
    | {"models": expand("<results>/cases/{case}/model.h5", case=INVERTED)},
    arguments=NAMED
    | {
        "cases": INVERTED,
        "held_out": STUDY.folds.held_out,
        "tolerance": config["invert"]["tolerance"],
        "seed": SEED,
    },
)


rule measure_inverse:
    input:
        model="<results>/cases/{case}/model.h5",
        plan="<results>/cases/{case}/plan.json",
        achieved=lambda wildcards: expand(
            "<results>/cases/{case}/achieved.json", case={wildcards.case} & {*OUTCOMES}
        ),
        postop=lambda wildcards: expand(
            "<results>/cases/{case}/postop.h5", case={wildcards.case} & {*OUTCOMES}
        ),
        truth=lambda wildcards: expand(
            "<results>/virtual/{case}/truth.h5",
            case={wildcards.case} & {*OUTCOMES} if STUDY.cohort.virtual else [],
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
