# Training comes first where it can, pretraining before all: short jobs fill the cores at the end.
rule pretrain:
    input:
        models=INPUTS.training.gathered("model"),
        lifts=INPUTS.training.gathered("lift"),
        samples=INPUTS.training.gathered("samples"),
    output:
        network=update("<results>/folds/{fold}/{method}/pretrained.pt"),
        history=update("<results>/folds/{fold}/{method}/pretraining.csv"),
    log:
        "<logs>/pretrain/{fold}_{method}.log",
    benchmark:
        "<benchmarks>/pretrain/{fold}_{method}.tsv"
    wildcard_constraints:
        method=any_of(STUDY.methods.pretrained),
    priority: 2
    conda:
        "../envs/pinnochio.yaml"
    resources:
        mem_mb=megabytes(lambda wildcards, _: INPUTS.training.memory(wildcards)),
        runtime=240,
        gpu=GPU,
    params:
        cases=INPUTS.training.cases,
        learner=INPUTS.training.learner,
        settings=INPUTS.training.settings("network", "pretraining", "fem"),
        seed=TRAINING_SEED,
        code=code_with_method("scripts.training.pretrain", INPUTS.training.learner),
    message:
        "Pretrain {wildcards.method} on the finite-element samples of fold {wildcards.fold}"
    script:
        "../scripts/training/pretrain.py"


rule finetune:
    input:
        network=INPUTS.training.pretrained,
        models=INPUTS.training.gathered("model"),
        lifts=INPUTS.training.gathered("lift"),
        scans=INPUTS.training.gathered("scan"),
        covariates=INPUTS.training.gathered("covariates"),
    output:
        network=update("<results>/folds/{fold}/{method}/network.pt"),
        history=update("<results>/folds/{fold}/{method}/finetuning.csv"),
    log:
        "<logs>/finetune/{fold}_{method}.log",
    benchmark:
        "<benchmarks>/finetune/{fold}_{method}.tsv"
    wildcard_constraints:
        method=any_of(STUDY.methods.trained("by steps")),
    priority: 1
    conda:
        "../envs/pinnochio.yaml"
    resources:
        mem_mb=megabytes(lambda wildcards, _: INPUTS.training.memory(wildcards)),
        runtime=240,
        gpu=GPU,
    params:
        cases=INPUTS.training.cases,
        learner=INPUTS.training.learner,
        settings=INPUTS.training.settings(
            "network", "finetuning", "fem", "newton_corrections"
        ),
        seed=TRAINING_SEED,
        code=code_with_method("scripts.training.finetune", INPUTS.training.learner),
    message:
        "Adapt {wildcards.method} to the post-operative skins of fold {wildcards.fold}"
    script:
        "../scripts/training/finetune.py"


rule fit:
    input:
        models=INPUTS.training.gathered("model"),
        samples=INPUTS.training.gathered("samples"),
        scans=INPUTS.training.gathered("scan"),
        covariates=INPUTS.training.gathered("covariates"),
    output:
        fitted=update("<results>/folds/{fold}/{method}/fitted.h5"),
    log:
        "<logs>/fit/{fold}_{method}.log",
    benchmark:
        "<benchmarks>/fit/{fold}_{method}.tsv"
    wildcard_constraints:
        method=any_of(STUDY.methods.trained("at once")),
    conda:
        "../envs/pinnochio.yaml"
    resources:
        mem_mb=megabytes(4000),
        runtime=30,
    params:
        cases=INPUTS.training.cases,
        learner=INPUTS.training.learner,
        settings=INPUTS.training.settings("fem"),
        code=code_with_method("scripts.training.fit", INPUTS.training.learner),
    message:
        "Fit {wildcards.method} to the training patients of fold {wildcards.fold}"
    script:
        "../scripts/training/fit.py"


rule networks:
    input:
        expand(
            "<results>/folds/{fold}/{method}/network.pt",
            fold=STUDY.folds.held_out,
            method=STUDY.methods.learned,
        ),
    message:
        "All networks are trained"


rule plot_training:
    input:
        pretraining=lambda wildcards: (
            "<results>/folds/{fold}/{method}/pretraining.csv"
            if STUDY.methods.phases(wildcards.method)["pretraining"]
            else []
        ),
        finetuning="<results>/folds/{fold}/{method}/finetuning.csv",
    output:
        picture=captioned("<results>/folds/{fold}/{method}/training.png"),
    log:
        "<logs>/plot_training/{fold}_{method}.log",
    wildcard_constraints:
        method=any_of(STUDY.methods.of_family("graph network", "surface network")),
    conda:
        "../envs/pinnochio.yaml"
    resources:
        mem_mb=1000,
        runtime=5,
    params:
        title=lambda wildcards: f"{wildcards.method}, fold {wildcards.fold}, {COHORT}",
        code=code_of("scripts.training.plot_training"),
    message:
        "Draw the training of {wildcards.method} in fold {wildcards.fold}"
    script:
        "../scripts/training/plot_training.py"


rule curves:
    input:
        expand(
            "<results>/folds/{fold}/{method}/training.png",
            fold=STUDY.folds.held_out,
            method=STUDY.methods.learned,
        ),
    message:
        "The trainings are drawn"
