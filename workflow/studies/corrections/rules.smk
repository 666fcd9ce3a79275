# Newton corrections between a network's field and equilibrium on its interface; not part of `all`.

check_networks("corrections.methods", config["corrections"]["methods"])
COUNTS = [0, *config["corrections"]["counts"]]
add_table(
    "corrections",
    "studies.corrections.table",
    title="Newton corrections after the network",
    caption="From a network's field to equilibrium, one Newton correction after another.",
    figure="studies.corrections.figure",
    files={
        "metrics": [
            file
            for method in STUDY.methods.learned_in("corrections")
            for count in COUNTS
            for file in expand(
                METRICS.replace("metrics", f"corrected_{count}/metrics"),
                fold=STUDY.folds.held_out,
                method=method,
            )
        ],
        "baseline": expand(
            METRICS,
            fold=STUDY.folds.held_out,
            method=[BASELINE] if BASELINE in STUDY.methods.used else [],
        ),
    },
    arguments=NAMED
    | {
        "methods": STUDY.methods.learned_in("corrections"),
        "corrections": COUNTS,
        "seed": SEED,
    },
)


# Timed, so each of these jobs has the machine for itself.
rule correct:
    input:
        predictions="<results>/folds/{fold}/{method}/predictions.h5",
        models=INPUTS.prediction.of_held_out("<results>/cases/{case}/model.h5"),
    output:
        corrected=expand(
            "<results>/folds/{fold}/{method}/corrected_{corrections}/predictions.h5",
            corrections=COUNTS,
            allow_missing=True,
        ),
    log:
        "<logs>/correct/{fold}_{method}.log",
    benchmark:
        "<benchmarks>/correct/{fold}_{method}.tsv"
    wildcard_constraints:
        method=any_of(NETWORKS),
    conda:
        "../../../envs/pinnochio.yaml"
    threads: ALL_CORES
    resources:
        mem_mb=4000,
        runtime=60,
    params:
        cases=INPUTS.prediction.held_out,
        corrections=COUNTS,
        fem=config["fem"],
        code=code_of("studies.corrections.correct"),
    message:
        "Correct {wildcards.method} on fold {wildcards.fold}"
    script:
        "correct.py"


rule corrections:
    input:
        recorded("corrections"),
        "<results>/figures/corrections.png",
    message:
        "The corrections are measured"
