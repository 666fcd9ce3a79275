# Judges what others have predicted.
rule evaluate:
    input:
        unpack(INPUTS.prediction.gathered),
        predictions="<results>/{batch}/{method}/predictions.h5",
    output:
        metrics=ensure("<results>/{batch}/{method}/metrics.csv", non_empty=True),
        skins="<results>/{batch}/{method}/skins.h5",
    log:
        "<logs>/evaluate/{batch}_{method}.log",
    benchmark:
        "<benchmarks>/evaluate/{batch}_{method}.tsv"
    conda:
        "../envs/pinnochio.yaml"
    resources:
        mem_mb=4000,
        runtime=30,
    params:
        cases=INPUTS.prediction.of_batch("cases"),
        scanned=INPUTS.prediction.of_batch("scanned"),
        fem=config["fem"],
        seed=SEED,
        code=code_of("scripts.tables.evaluate"),
    message:
        "Measure {wildcards.method} on {wildcards.batch}"
    script:
        "../scripts/tables/evaluate.py"


rule provenance:
    input:
        "<results>/tables/cases.csv",
        "<results>/tables/accuracy.csv" if STUDY.cohort.scanned else [],
    output:
        "<results>/provenance.json",
    log:
        "<logs>/provenance.log",
    conda:
        "../envs/pinnochio.yaml"
    resources:
        mem_mb=500,
        runtime=5,
    params:
        # The script knows both; here they say when to record anew.
        config=config,
        code=code_hash(*stages()),
    message:
        "Record configuration, versions, code and machine"
    script:
        "../scripts/tables/provenance.py"


# Further tables are made after the study, by another commit perhaps or on another machine; recorded anew with the table
# alone, whatever is configured later.
rule provenance_of_table:
    input:
        "<results>/{folder}/{table}.csv",
    output:
        "<results>/{folder}/{table}.provenance.json",
    log:
        "<logs>/provenance/{folder}_{table}.log",
    wildcard_constraints:
        folder="tables|virtual",
        table="|".join(TABLES),
    conda:
        "../envs/pinnochio.yaml"
    resources:
        mem_mb=500,
        runtime=5,
    params:
        code=code_of("scripts.tables.provenance"),
    message:
        "Record what made {wildcards.folder}/{wildcards.table}"
    script:
        "../scripts/tables/provenance.py"


# A picture of one patient: before, outcome and some methods with their errors; asked for by name.
rule render_case:
    input:
        models=lambda wildcards: [
            STUDY.model_of(wildcards.case, method) for method in INPUTS.tables.pictured
        ],
        plan=INPUTS.patient.motion,
        postop="<results>/cases/{case}/postop.h5",
        predictions=lambda wildcards: expand(
            "<results>/folds/{fold}/{method}/predictions.h5",
            fold=STUDY.folds.by_case[wildcards.case],
            method=INPUTS.tables.pictured,
        ),
    output:
        picture=captioned("<results>/figures/{case}.png", "picture"),
        view="<results>/figures/{case}.json",
    log:
        "<logs>/render_case/{case}.log",
    wildcard_constraints:
        case=any_of(STUDY.cohort.cases),
    conda:
        "../envs/pinnochio.yaml"
    resources:
        mem_mb=2000,
        runtime=10,
    params:
        methods=INPUTS.tables.pictured,
        code=code_of("scripts.tables.render_case"),
    message:
        "Draw {wildcards.case}: before, outcome and methods"
    script:
        "../scripts/tables/render_case.py"


rule tables:
    input:
        table_and_twins(*INPUTS.tables.measured),
    message:
        "The tables are made"


rule tabulate:
    input:
        lambda wildcards: BEFORE.get(wildcards.table, []),
        unpack(files_of_table),
    output:
        table=ensure("<results>/{folder}/{table}.csv", non_empty=True),
        markdown="<results>/{folder}/{table}.md",
        latex="<results>/{folder}/{table}.tex",
        html=report(
            "<results>/{folder}/{table}.html",
            caption="../workflow/report/table.rst",
            category=part_of,
        ),
    log:
        "<logs>/tabulate/{folder}_{table}.log",
    wildcard_constraints:
        folder="tables|virtual",
        table="|".join(TABLES),
    conda:
        "../envs/pinnochio.yaml"
    resources:
        mem_mb=2000,
        runtime=10,
    params:
        module=module_of,
        arguments=lambda wildcards: TABLES[wildcards.table][1],
        caption=caption_of,
        code=lambda wildcards: code_of("scripts.tables.tabulate", module_of(wildcards)),
    message:
        "Make the table {wildcards.table}"
    script:
        "../scripts/tables/tabulate.py"


rule render_table:
    input:
        table="<results>/tables/{table}.csv",
    output:
        picture=report(
            "<results>/figures/{table}.png",
            caption="../workflow/report/table.rst",
            category=part_of,
        ),
        drawing="<results>/figures/{table}.svg",
    log:
        "<logs>/render_table/{table}.log",
    wildcard_constraints:
        table=any_of(FIGURES),
    conda:
        "../envs/pinnochio.yaml"
    resources:
        mem_mb=1000,
        runtime=5,
    params:
        caption=caption_of,
        module=lambda wildcards: FIGURES[wildcards.table],
        code=lambda wildcards: code_of(
            "scripts.tables.render_table", FIGURES[wildcards.table]
        ),
    message:
        "Draw the table {wildcards.table}"
    script:
        "../scripts/tables/render_table.py"


# Read from the benchmark files of the study's jobs; these differ from run to run and are no input.
rule cost:
    input:
        table_and_twins(*INPUTS.tables.costs),
    message:
        "The cost of the study is known"
