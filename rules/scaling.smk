# What the stages cost against the nodes of the mesh and the number of patients; not part of `all`.


# Timed, so each of these jobs has the machine for itself; its stages run on one thread.
rule measure_scaling:
    input:
        labels=f"<results>/cases/{STUDY.measured}/labels.nii.gz",
        bone=f"<results>/cases/{STUDY.measured}/bone.vtp",
        skin=f"<results>/cases/{STUDY.measured}/skin.vtp",
        report=f"<results>/cases/{STUDY.measured}/import.json",
        plan=f"<results>/cases/{STUDY.measured}/plan.json",
        postop=f"<results>/cases/{STUDY.measured}/postop.h5" if STUDY.scanned else [],
        truth=f"<results>/virtual/{STUDY.measured}/truth.h5" if STUDY.virtual else [],
        networks=expand(
            "<results>/folds/{fold}/{method}/network.pt",
            fold=STUDY.fold_of(STUDY.measured),
            method=STUDY.asked("scaling"),
        ),
    output:
        table=ensure("<results>/scaling/{nodes}.csv", non_empty=True),
    log:
        "<logs>/measure_scaling/{nodes}.log",
    benchmark:
        "<benchmarks>/measure_scaling/{nodes}.tsv"
    conda:
        "../envs/pinnochio.yaml"
    threads: ALL_CORES
    resources:
        mem_mb=12000,
        runtime=120,
    params:
        case=STUDY.measured,
        methods=STUDY.asked("scaling"),
        variants={method: NETWORKS[method] for method in STUDY.asked("scaling")},
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
        qualities=expand("<results>/cases/{case}/quality.json", case=STUDY.counted),
        scanned=expand(
            "<results>/cases/{case}/{file}",
            case=[name for name in STUDY.counted if name in STUDY.scanned],
            file=["postop.h5", "fem_samples.h5"] if STUDY.learned else ["postop.h5"],
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
        held_out=STUDY.held_out,
        training={
            fold: len([name for name in STUDY.scanned if name not in cases])
            for fold, cases in STUDY.held_out.items()
        },
        methods=STUDY.methods,
        cases=list(STUDY.cases),
        nodes=config["mesh"]["nodes"],
        counts=STUDY.counts,
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
