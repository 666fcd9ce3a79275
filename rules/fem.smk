# A patient's own plan by finite elements, with fields to look at; needs no scan and no training.
rule solve_plan:
    input:
        model="<results>/cases/{case}/model.h5",
        plan="<results>/cases/{case}/plan.json",
    output:
        field="<results>/cases/{case}/fem/{arm}.vtu",
        summary="<results>/cases/{case}/fem/{arm}.json",
        picture="<results>/cases/{case}/fem/{arm}.png",
    log:
        "<logs>/solve_plan/{case}_{arm}.log",
    benchmark:
        "<benchmarks>/solve_plan/{case}_{arm}.tsv"
    wildcard_constraints:
        arm=r"bonded|mucosa|mucosa\+lip",
    conda:
        "../envs/pinnochio.yaml"
    resources:
        mem_mb=4000,
        runtime=30,
    params:
        fem=config["fem"],
        code=code_of("scripts.fem.solve_plan"),
    message:
        "Solve the plan of {wildcards.case} by finite elements ({wildcards.arm})"
    script:
        "../scripts/fem/solve_plan.py"


rule fem:
    input:
        expand("<results>/cases/{case}/fem/mucosa.json", case=STUDY.cohort.cases),
    message:
        "Every patient's plan is solved by finite elements"


rule unscanned:
    input:
        expand("<results>/cases/{case}/fem/mucosa.json", case=STUDY.cohort.unscanned),
    message:
        "The patients without a scan are solved by finite elements"
