rule evaluate:
    input:
        predictions="<results>/folds/{fold}/{method}{corrected}/predictions.h5",
        models=STUDY.models_of_held_out,
        plans=STUDY.of_held_out("<results>/cases/{case}/plan.json"),
        postops=STUDY.of_judged("<results>/cases/{case}/postop.h5"),
        truths=(
            STUDY.of_held_out("<results>/virtual/{case}/truth.h5")
            if STUDY.virtual
            else []
        ),
    output:
        metrics=ensure(
            "<results>/folds/{fold}/{method}{corrected}/metrics.csv", non_empty=True
        ),
    log:
        "<logs>/evaluate/{fold}_{method}{corrected}.log",
    benchmark:
        "<benchmarks>/evaluate/{fold}_{method}{corrected}.tsv"
    wildcard_constraints:
        corrected=r"|/corrected_\d+",
    conda:
        "../envs/pinnochio.yaml"
    threads: 1
    resources:
        mem_mb=4000,
        runtime=30,
    params:
        cases=STUDY.held_out_cases,
        scanned=STUDY.judged_cases,
        samples=config["evaluation"]["samples"],
        fem=config["fem"],
        seed=SEED,
        code=code_of("evaluate"),
    message:
        "Measure {wildcards.method}{wildcards.corrected} on fold {wildcards.fold}"
    script:
        "../scripts/evaluate.py"


rule collect_cases:
    input:
        metrics=expand(
            "<results>/folds/{fold}/{method}/metrics.csv",
            fold=STUDY.held_out,
            method=STUDY.methods,
        ),
    output:
        table=ensure("<results>/tables/cases.csv", non_empty=True),
        markdown="<results>/tables/cases.md",
        latex="<results>/tables/cases.tex",
        html="<results>/tables/cases.html",
    log:
        "<logs>/collect_cases.log",
    conda:
        "../envs/pinnochio.yaml"
    threads: 1
    resources:
        mem_mb=1000,
        runtime=5,
    params:
        cohort=COHORT,
        code=code_of("collect_cases"),
    message:
        "Collect one row per case and method"
    script:
        "../scripts/collect_cases.py"


rule compare_methods:
    input:
        cases="<results>/tables/cases.csv",
    output:
        table=ensure("<results>/tables/accuracy.csv", non_empty=True),
        markdown="<results>/tables/accuracy.md",
        latex="<results>/tables/accuracy.tex",
        html=captioned("<results>/tables/accuracy.html"),
    log:
        "<logs>/compare_methods.log",
    conda:
        "../envs/pinnochio.yaml"
    threads: 1
    resources:
        mem_mb=1000,
        runtime=5,
    params:
        cohort=COHORT,
        reference=STUDY.reference,
        methods=STUDY.methods,
        seed=SEED,
        published=True,
        code=code_of("compare_methods"),
    message:
        "Test every method against the reference"
    script:
        "../scripts/compare_methods.py"


# The same table with every method tested against the better network.
use rule compare_methods as compare_better with:
    output:
        table=ensure("<results>/tables/better.csv", non_empty=True),
        markdown="<results>/tables/better.md",
        latex="<results>/tables/better.tex",
        html=captioned("<results>/tables/better.html"),
    log:
        "<logs>/compare_better.log",
    params:
        cohort=COHORT,
        reference=config["design"]["base"],
        methods=STUDY.methods,
        seed=SEED,
        published=False,
        code=code_of("compare_methods"),
    message:
        "Test every method against {config[design][base]}"


# Where on the face: the same tests per region.
rule compare_regions:
    input:
        cases="<results>/tables/cases.csv",
    output:
        table=ensure("<results>/tables/regions.csv", non_empty=True),
        markdown="<results>/tables/regions.md",
        latex="<results>/tables/regions.tex",
        html=captioned("<results>/tables/regions.html"),
    log:
        "<logs>/compare_regions.log",
    conda:
        "../envs/pinnochio.yaml"
    threads: 1
    resources:
        mem_mb=1000,
        runtime=5,
    params:
        kind="regions",
        cohort=COHORT,
        reference=STUDY.reference,
        methods=STUDY.methods,
        seed=SEED,
        code=code_of("compare_regions"),
    message:
        "Compare the methods region by region"
    script:
        "../scripts/compare_regions.py"


# Of the virtual cohort the true displacement is known: at landmarks, over the skin and throughout.
use rule compare_regions as compare_landmarks with:
    output:
        table=ensure("<results>/tables/landmarks.csv", non_empty=True),
        markdown="<results>/tables/landmarks.md",
        latex="<results>/tables/landmarks.tex",
        html=captioned("<results>/tables/landmarks.html"),
    log:
        "<logs>/compare_landmarks.log",
    params:
        kind="landmarks",
        cohort=COHORT,
        reference=STUDY.reference,
        methods=STUDY.methods,
        seed=SEED,
        code=code_of("compare_regions"),
    message:
        "Compare the methods at landmarks and throughout"


rule ablate:
    input:
        cases="<results>/tables/cases.csv",
    output:
        table=ensure("<results>/tables/ablation.csv", non_empty=True),
        markdown="<results>/tables/ablation.md",
        latex="<results>/tables/ablation.tex",
        html=captioned("<results>/tables/ablation.html"),
    log:
        "<logs>/ablate.log",
    conda:
        "../envs/pinnochio.yaml"
    threads: 1
    resources:
        mem_mb=1000,
        runtime=5,
    params:
        variants={name: NETWORKS[name] for name in config["ablation"]},
        cohort=COHORT,
        seed=SEED,
        code=code_of("ablate"),
    message:
        "Compare the network with what is left of it without its parts"
    script:
        "../scripts/ablate.py"


rule provenance:
    input:
        "<results>/tables/cases.csv",
        "<results>/tables/accuracy.csv" if STUDY.scanned else [],
    output:
        "<results>/provenance.json",
    log:
        "<logs>/provenance.log",
    conda:
        "../envs/pinnochio.yaml"
    threads: 1
    resources:
        mem_mb=500,
        runtime=5,
    params:
        config=config,
        code=code_of(*STAGES),
    message:
        "Record configuration, versions, code and machine"
    script:
        "../scripts/provenance.py"


# A picture of one patient: before, outcome and every method with its error; asked for by name.
rule render_case:
    input:
        models=lambda wildcards: [
            STUDY.model_of(wildcards.case, method) for method in STUDY.methods
        ],
        plan="<results>/cases/{case}/plan.json",
        postop="<results>/cases/{case}/postop.h5",
        predictions=lambda wildcards: expand(
            "<results>/folds/{fold}/{method}/predictions.h5",
            fold=STUDY.fold_of(wildcards.case),
            method=STUDY.methods,
        ),
    output:
        picture=captioned("<results>/figures/{case}.png", "picture"),
        view="<results>/figures/{case}.json",
    log:
        "<logs>/render_case/{case}.log",
    conda:
        "../envs/pinnochio.yaml"
    threads: 1
    resources:
        mem_mb=2000,
        runtime=10,
    params:
        methods=STUDY.methods,
        code=code_of("render_case"),
    message:
        "Draw {wildcards.case}: before, outcome and every method"
    script:
        "../scripts/render_case.py"


rule tables:
    input:
        rules.collect_cases.output,
        rules.compare_methods.output if STUDY.scanned else [],
        rules.compare_better.output if STUDY.better else [],
        rules.compare_regions.output if STUDY.scanned else [],
        rules.compare_landmarks.output if STUDY.scanned and STUDY.virtual else [],
        rules.ablate.output if STUDY.ablated else [],
    message:
        "The tables are made"
