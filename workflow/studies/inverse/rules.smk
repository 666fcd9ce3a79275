# From a wished face to a plan, and how well the motion is found that made a face; not part of `all`.

from studies.inverse.inputs import WishInputs, check_bounds

with plainly():
    check_bounds(config["invert"]["bounds"])
WISHES = WishInputs(STUDY, INPUTS.patients)
INVERTED = list(STUDY.cohort.cases)[: config["invert"]["patients"]]
# Patients of whom scan and bones after surgery are there.
OUTCOMES = [name for name in STUDY.cohort.registered if name in STUDY.cohort.scanned]
add_table(
    "inverse",
    "studies.inverse.table",
    caption="How well the motion of the bones is found that made a face.",
    files={
        "recovered": expand("<results>/inverse/{case}/recovered.csv", case=INVERTED)
    },
    arguments=NAMED | {"seed": SEED},
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


rule propose:
    input:
        model="<results>/{home}/{case}/model.h5",
        wish=WISHES.files,
        markups=INPUTS.patient.markups,
        occlusion=WISHES.occlusion,
        calibration=WISHES.calibration,
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
        "../../../envs/pinnochio.yaml"
    resources:
        mem_mb=4000,
        runtime=30,
    params:
        fem=INPUTS.patient.setting("fem"),
        settings=config["invert"],
        content=content(WISHES.files, INPUTS.patient.markups),
        code=code_of("studies.inverse.propose"),
    message:
        "Seek plans that bring {wildcards.case} to the wished face"
    script:
        "propose.py"


rule invert:
    input:
        WISHES.proposals,
    message:
        "The wishes are answered: see {config[pathvars][results]}/patients"
