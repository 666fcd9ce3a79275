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


rule scaling:
    input:
        table_and_twins("scaling"),
        "<results>/tables/scaling_patients.csv",
        "<results>/tables/scaling_exponents.csv",
        expand("<results>/figures/scaling.{kind}", kind=["png", "svg"]),
    message:
        "What the stages cost against size is measured"
