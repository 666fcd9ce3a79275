rule evaluate:
    input:
        predictions="<results>/folds/{fold}/{method}/predictions.h5",
        models=models_of_held_out,
        plans=of_held_out("<results>/cases/{case}/plan.json"),
        postops=of_scanned("<results>/cases/{case}/postop.h5"),
        truths=of_held_out("<results>/virtual/{case}/truth.h5") if VIRTUAL else [],
    output:
        metrics=ensure("<results>/folds/{fold}/{method}/metrics.csv", non_empty=True),
    log:
        "<logs>/evaluate/{fold}_{method}.log",
    benchmark:
        "<benchmarks>/evaluate/{fold}_{method}.tsv"
    conda:
        "../envs/pinnochio.yaml"
    threads: 1
    resources:
        mem_mb=4000,
        runtime=30,
    params:
        cases=held_out,
        scanned=scanned_of,
        samples=config["evaluation"]["samples"],
        fem=config["fem"],
        seed=SEED,
        code=code_of("evaluate"),
    message:
        "Measure {wildcards.method} on fold {wildcards.fold}"
    script:
        "../scripts/evaluate.py"


rule collect_cases:
    input:
        metrics=expand(
            "<results>/folds/{fold}/{method}/metrics.csv",
            fold=HELD_OUT,
            method=METHODS,
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
        reference=REFERENCE,
        methods=METHODS,
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
        methods=METHODS,
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
        reference=REFERENCE,
        methods=METHODS,
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
        reference=REFERENCE,
        methods=METHODS,
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
        variants={name: VARIANTS[name] for name in config["ablation"]},
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
        "<results>/tables/accuracy.csv" if SCANNED else [],
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
        code=code_of("provenance"),
    message:
        "Record configuration, versions, code and machine"
    script:
        "../scripts/provenance.py"


# A picture of one patient: before, outcome and every method with its error; asked for by name.
rule render_case:
    input:
        models=lambda wildcards: [
            model_of(wildcards.case, method)[0] for method in METHODS
        ],
        plan="<results>/cases/{case}/plan.json",
        postop="<results>/cases/{case}/postop.h5",
        predictions=lambda wildcards: expand(
            "<results>/folds/{fold}/{method}/predictions.h5",
            fold=fold_of(wildcards.case),
            method=METHODS,
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
        methods=METHODS,
        code=code_of("render_case"),
    message:
        "Draw {wildcards.case}: before, outcome and every method"
    script:
        "../scripts/render_case.py"


rule tables:
    input:
        rules.collect_cases.output,
        rules.compare_methods.output if SCANNED else [],
        rules.compare_better.output if BETTER else [],
        rules.compare_regions.output if SCANNED else [],
        rules.compare_landmarks.output if SCANNED and VIRTUAL else [],
        rules.ablate.output if ABLATED else [],
    message:
        "The tables are made"
