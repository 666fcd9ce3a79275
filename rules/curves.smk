rule plot_training:
    input:
        pretraining=lambda wildcards: (
            "<results>/folds/{fold}/{method}/pretraining.csv"
            if STUDY.phases(wildcards.method)["pretraining"]
            else []
        ),
        finetuning="<results>/folds/{fold}/{method}/finetuning.csv",
    output:
        picture=captioned("<results>/folds/{fold}/{method}/training.png"),
    log:
        "<logs>/plot_training/{fold}_{method}.log",
    wildcard_constraints:
        method=any_of(STUDY.of_family("graph network", "surface network")),
    conda:
        "../envs/pinnochio.yaml"
    threads: 1
    resources:
        mem_mb=1000,
        runtime=5,
    params:
        title=lambda wildcards: f"{wildcards.method}, fold {wildcards.fold}, {COHORT}",
        code=code_of("plot_training"),
    message:
        "Draw the training of {wildcards.method} in fold {wildcards.fold}"
    script:
        "../scripts/plot_training.py"


rule curves:
    input:
        expand(
            "<results>/folds/{fold}/{method}/training.png",
            fold=STUDY.held_out,
            method=STUDY.learned,
        ),
    message:
        "The trainings are drawn"
