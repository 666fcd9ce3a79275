# A patient with its models, for a person who tries plans by hand: workflow/plan.py; not part of `all`.

from studies.planner.inputs import PlannerInputs

PLANNERS = PlannerInputs(STUDY, INPUTS.patients)


rule prepare_planner:
    input:
        model="<results>/{home}/{case}/model.h5",
        skin="<results>/{home}/{case}/skin.vtp",
        bone="<results>/{home}/{case}/bone.vtp",
        lifts=INPUTS.prediction.of_ensemble("lifts"),
        quality="<results>/{home}/{case}/quality.json",
        plans=INPUTS.patients.plans,
        archive=lambda wildcards: STUDY.choice.files,
    output:
        prepared="<results>/{home}/{case}/planner.json",
    log:
        "<logs>/prepare_planner/{home}/{case}.log",
    conda:
        "../../../envs/pinnochio.yaml"
    resources:
        mem_mb=1000,
        runtime=5,
    params:
        settings=PLANNERS.settings,
        code=code_of("studies.planner.prepare_planner"),
    message:
        "Prepare {wildcards.case} for the planner"
    script:
        "prepare_planner.py"


rule planner:
    input:
        PLANNERS.files,
    message:
        "Open the planner: python workflow/plan.py {input}"
