# Training comes first where it can, pretraining before all: short jobs fill the cores at the end.
rule pretrain:
    input:
        models=STUDY.of_training("<results>/cases/{case}/model.h5"),
        lifts=STUDY.lifts_of_training,
        fem_samples=STUDY.of_training("<results>/cases/{case}/fem_samples.h5"),
    output:
        network="<results>/folds/{fold}/{method}/pretrained.pt",
        history="<results>/folds/{fold}/{method}/pretraining.csv",
    log:
        "<logs>/pretrain/{fold}_{method}.log",
    benchmark:
        "<benchmarks>/pretrain/{fold}_{method}.tsv"
    wildcard_constraints:
        method=any_of(STUDY.pretrained_first),
    priority: 2
    conda:
        "../envs/pinnochio.yaml"
    resources:
        mem_mb=6000,
        runtime=240,
        gpu=GPU,
    params:
        cases=STUDY.training_cases,
        learner=STUDY.learner,
        settings=STUDY.settings("network", "pretraining", "fem"),
        seed=SEED,
        code=code_with_method("scripts.training.pretrain", "learner"),
    message:
        "Pretrain {wildcards.method} on the finite-element samples of fold {wildcards.fold}"
    script:
        "../scripts/training/pretrain.py"


rule finetune:
    input:
        network=STUDY.pretrained,
        models=STUDY.of_training("<results>/cases/{case}/model.h5"),
        lifts=STUDY.lifts_of_training,
        plans=STUDY.motions_of_training,
        postops=STUDY.of_training("<results>/cases/{case}/postop.h5"),
        covariates=STUDY.covariates_of_training,
    output:
        network="<results>/folds/{fold}/{method}/network.pt",
        history="<results>/folds/{fold}/{method}/finetuning.csv",
    log:
        "<logs>/finetune/{fold}_{method}.log",
    benchmark:
        "<benchmarks>/finetune/{fold}_{method}.tsv"
    wildcard_constraints:
        method=any_of(STUDY.trained_here),
    priority: 1
    conda:
        "../envs/pinnochio.yaml"
    resources:
        mem_mb=6000,
        runtime=240,
        gpu=GPU,
    params:
        cases=STUDY.training_cases,
        learner=STUDY.learner,
        settings=STUDY.settings("network", "finetuning", "fem", "newton_corrections"),
        seed=SEED,
        code=code_with_method("scripts.training.finetune", "learner"),
    message:
        "Adapt {wildcards.method} to the post-operative skins of fold {wildcards.fold}"
    script:
        "../scripts/training/finetune.py"


# Where the configuration says `networks: archive`, in place of both.
rule take_network:
    input:
        manifest=STUDY.manifest_of_networks,
    output:
        network="<results>/folds/{fold}/{method}/network.pt",
        history="<results>/folds/{fold}/{method}/finetuning.csv",
    log:
        "<logs>/take_network/{fold}_{method}.log",
    wildcard_constraints:
        method=any_of(STUDY.taken),
    conda:
        "../envs/pinnochio.yaml"
    resources:
        mem_mb=1000,
        runtime=5,
    params:
        archive=config["networks_archive"],
        names=STUDY.of_archive("network.pt", "finetuning.csv"),
        code=code_of("scripts.training.take_network"),
    message:
        "Take {wildcards.method} of fold {wildcards.fold} from the archive"
    script:
        "../scripts/training/take_network.py"


rule fit:
    input:
        models=STUDY.of_training("<results>/cases/{case}/model.h5"),
        fem_samples=STUDY.of_training("<results>/cases/{case}/fem_samples.h5"),
        plans=STUDY.motions_of_training,
        postops=STUDY.of_training("<results>/cases/{case}/postop.h5"),
        covariates=STUDY.covariates_of_training,
    output:
        fitted="<results>/folds/{fold}/{method}/fitted.h5",
    log:
        "<logs>/fit/{fold}_{method}.log",
    benchmark:
        "<benchmarks>/fit/{fold}_{method}.tsv"
    wildcard_constraints:
        method=any_of(STUDY.trained("at once")),
    conda:
        "../envs/pinnochio.yaml"
    resources:
        mem_mb=4000,
        runtime=30,
    params:
        cases=STUDY.training_cases,
        learner=STUDY.learner,
        settings=STUDY.settings("fem"),
        code=code_with_method("scripts.training.fit", "learner"),
    message:
        "Fit {wildcards.method} to the training patients of fold {wildcards.fold}"
    script:
        "../scripts/training/fit.py"


rule networks:
    input:
        expand(
            "<results>/folds/{fold}/{method}/network.pt",
            fold=STUDY.held_out,
            method=STUDY.learned,
        ),
    message:
        "All networks are trained"


use rule take_network as take_pretraining with:
    output:
        history="<results>/folds/{fold}/{method}/pretraining.csv",
    log:
        "<logs>/take_pretraining/{fold}_{method}.log",
    params:
        archive=config["networks_archive"],
        names=STUDY.of_archive("pretraining.csv"),
        code=code_of("scripts.training.take_network"),
    message:
        "Take the pretraining of {wildcards.method} of fold {wildcards.fold} from the archive"


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
            fold=STUDY.held_out,
            method=STUDY.learned,
        ),
    message:
        "The trainings are drawn"
