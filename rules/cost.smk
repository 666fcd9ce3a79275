# What the study costs, read from the benchmark files of its jobs; these differ from run to run and are no input.


rule tabulate_training:
    input:
        networks=expand(
            "<results>/folds/{fold}/{method}/network.pt",
            method=STUDY.learned,
            fold=STUDY.held_out,
        ),
    output:
        table=ensure("<results>/tables/training.csv", non_empty=True),
        markdown="<results>/tables/training.md",
        latex="<results>/tables/training.tex",
        html=captioned("<results>/tables/training.html"),
    log:
        "<logs>/tabulate_training.log",
    conda:
        "../envs/pinnochio.yaml"
    threads: 1
    resources:
        mem_mb=1000,
        runtime=5,
    params:
        settings={
            method: {
                phase: STUDY.registry[method].settings.get(phase)
                for phase in ("pretraining", "finetuning")
            }
            for method in STUDY.learned
        },
        folds=list(STUDY.held_out),
        benchmarks=BENCHMARKS,
        cohort=COHORT,
        code=code_of("tabulate_training"),
    message:
        "List what each learned method was given"
    script:
        "../scripts/tabulate_training.py"


# Last of all, when the other tables are made.
rule time_stages:
    input:
        rules.tables.input,
        rules.quality.input,
        rules.unscanned.input,
        rules.tabulate_training.output if STUDY.learned else [],
    output:
        table=ensure("<results>/tables/stages.csv", non_empty=True),
        markdown="<results>/tables/stages.md",
        latex="<results>/tables/stages.tex",
        html=captioned("<results>/tables/stages.html"),
    log:
        "<logs>/time_stages.log",
    conda:
        "../envs/pinnochio.yaml"
    threads: 1
    resources:
        mem_mb=1000,
        runtime=5,
    params:
        benchmarks=BENCHMARKS,
        cohort=COHORT,
        code=code_of("time_stages"),
    message:
        "Add up the time of every stage"
    script:
        "../scripts/time_stages.py"


rule cost:
    input:
        rules.time_stages.output,
        rules.tabulate_training.output if STUDY.learned else [],
    message:
        "The cost of the study is known"
