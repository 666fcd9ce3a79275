# What the stages cost against the nodes of the mesh and the number of patients; not part of `all`.


# Timed, so each of these jobs has the machine for itself; its stages run on one thread.
rule measure_scaling:
    input:
        labels=f"<results>/cases/{MEASURED}/labels.nii.gz",
        bone=f"<results>/cases/{MEASURED}/bone.vtp",
        skin=f"<results>/cases/{MEASURED}/skin.vtp",
        report=f"<results>/cases/{MEASURED}/import.json",
        plan=f"<results>/cases/{MEASURED}/plan.json",
        postop=f"<results>/cases/{MEASURED}/postop.h5" if SCANNED else [],
        truth=f"<results>/virtual/{MEASURED}/truth.h5" if VIRTUAL else [],
        networks=expand(
            "<results>/folds/{fold}/{method}/network.pt",
            fold=fold_of(MEASURED),
            method=SCALED,
        ),
    output:
        table=ensure("<results>/scaling/{nodes}.csv", non_empty=True),
    log:
        "<logs>/measure_scaling/{nodes}.log",
    benchmark:
        "<benchmarks>/measure_scaling/{nodes}.tsv"
    conda:
        "../envs/pinnochio.yaml"
    threads: workflow.cores
    resources:
        mem_mb=12000,
        runtime=120,
    params:
        case=MEASURED,
        methods=SCALED,
        variants={method: VARIANTS[method] for method in SCALED},
        sections={
            name: config[name]
            for name in [
                *("segments", "mesh", "interfaces", "fem", "lift", "evaluation"),
                "scaling",
            ]
        },
        seed=SEED,
        code=code_of("measure_scaling"),
    message:
        "Measure every stage on {wildcards.nodes} nodes"
    script:
        "../scripts/measure_scaling.py"


# The benchmark files differ from run to run and are no input; the jobs that write them are asked for by what they make.
rule tabulate_scaling:
    input:
        sizes=expand("<results>/scaling/{nodes}.csv", nodes=config["scaling"]["nodes"]),
        qualities=expand("<results>/cases/{case}/quality.json", case=COUNTED),
        scanned=expand(
            "<results>/cases/{case}/{file}",
            case=[name for name in COUNTED if name in SCANNED],
            file=["postop.h5", "fem_samples.h5"] if LEARNED else ["postop.h5"],
        ),
    output:
        scaling=ensure("<results>/tables/scaling.csv", non_empty=True),
        patients=ensure("<results>/tables/scaling_patients.csv", non_empty=True),
        exponents=ensure("<results>/tables/scaling_exponents.csv", non_empty=True),
        markdown="<results>/tables/scaling.md",
        latex="<results>/tables/scaling.tex",
        html=captioned("<results>/tables/scaling.html"),
    log:
        "<logs>/tabulate_scaling.log",
    conda:
        "../envs/pinnochio.yaml"
    threads: 1
    resources:
        mem_mb=1000,
        runtime=5,
    params:
        results=lambda wildcards: RESULTS,
        benchmarks=BENCHMARKS,
        held_out=HELD_OUT,
        training={
            fold: len([name for name in SCANNED if name not in cases])
            for fold, cases in HELD_OUT.items()
        },
        methods=METHODS,
        cases=list(CASES),
        nodes=config["mesh"]["nodes"],
        counts=COUNTS,
        cluster=config["scaling"]["cluster"],
        cohort=COHORT,
        code=code_of("tabulate_scaling"),
    message:
        "Fit what every stage costs, and reckon {params.cluster} patients"
    script:
        "../scripts/tabulate_scaling.py"


rule render_scaling:
    input:
        table="<results>/tables/scaling.csv",
    output:
        picture=captioned("<results>/figures/scaling.png"),
        drawing="<results>/figures/scaling.svg",
    log:
        "<logs>/render_scaling.log",
    conda:
        "../envs/pinnochio.yaml"
    threads: 1
    resources:
        mem_mb=1000,
        runtime=5,
    params:
        code=code_of("render_scaling"),
    message:
        "Draw what every stage costs"
    script:
        "../scripts/render_scaling.py"


rule scaling:
    input:
        rules.tabulate_scaling.output,
        rules.render_scaling.output,
    message:
        "What the stages cost against size is measured"
