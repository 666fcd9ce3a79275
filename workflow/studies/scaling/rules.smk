# What the stages cost against the nodes of the mesh and the number of patients; not part of `all`.


# Timed, so each of these jobs has the machine for itself; its stages run on one thread.
rule measure_scaling:
    input:
        labels=f"<results>/cases/{STUDY.measured}/labels.nii.gz",
        bone=f"<results>/cases/{STUDY.measured}/bone.vtp",
        skin=f"<results>/cases/{STUDY.measured}/skin.vtp",
        report=f"<results>/cases/{STUDY.measured}/import.json",
        plan=STUDY.motion_of(STUDY.measured),
        postop=f"<results>/cases/{STUDY.measured}/postop.h5" if STUDY.scanned else [],
        judged=f"<results>/cases/{STUDY.measured}/judged.h5" if STUDY.scanned else [],
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
        "../../../envs/pinnochio.yaml"
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
                *("mesh", "interfaces", "fem", "lift", "scaling"),
            ]
        },
        seed=SEED,
        code=code_of("studies.scaling.measure_scaling"),
    message:
        "Measure every stage on {wildcards.nodes} nodes"
    script:
        "measure_scaling.py"


rule scaling:
    input:
        recorded("scaling"),
        "<results>/tables/scaling_patients.csv",
        "<results>/tables/scaling_exponents.csv",
        expand("<results>/figures/scaling.{kind}", kind=["png", "svg"]),
    message:
        "What the stages cost against size is measured"
