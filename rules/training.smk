# Training comes first where it can, pretraining before all: short jobs fill the cores at the end.
rule pretrain:
    input:
        models=STUDY.of_training("<results>/cases/{case}/model.h5"),
        lifts=lifts_of(training_cases),
        fem_samples=STUDY.of_training("<results>/cases/{case}/fem_samples.h5"),
    output:
        network="<results>/folds/{fold}/{method}/pretrained.pt",
        history="<results>/folds/{fold}/{method}/pretraining.csv",
    log:
        "<logs>/pretrain/{fold}_{method}.log",
    benchmark:
        "<benchmarks>/pretrain/{fold}_{method}.tsv"
    wildcard_constraints:
        method=any_of(NETWORKS),
    priority: 2
    conda:
        "../envs/pinnochio.yaml"
    threads: 1
    resources:
        mem_mb=6000,
        runtime=240,
        gpu=GPU,
    params:
        cases=training_cases,
        network=settings_of("network"),
        training=settings_of("pretraining"),
        fem=config["fem"],
        seed=SEED,
        code=code_of("pretrain"),
    message:
        "Pretrain {wildcards.method} on the finite-element fields of fold {wildcards.fold}"
    script:
        "../scripts/pretrain.py"


rule finetune:
    input:
        network="<results>/folds/{fold}/{method}/pretrained.pt",
        models=STUDY.of_training("<results>/cases/{case}/model.h5"),
        lifts=lifts_of(training_cases),
        plans=STUDY.of_training("<results>/cases/{case}/plan.json"),
        postops=STUDY.of_training("<results>/cases/{case}/postop.h5"),
    output:
        network="<results>/folds/{fold}/{method}/network.pt",
        history="<results>/folds/{fold}/{method}/finetuning.csv",
    log:
        "<logs>/finetune/{fold}_{method}.log",
    benchmark:
        "<benchmarks>/finetune/{fold}_{method}.tsv"
    wildcard_constraints:
        method=any_of(NETWORKS),
    priority: 1
    conda:
        "../envs/pinnochio.yaml"
    threads: 1
    resources:
        mem_mb=6000,
        runtime=240,
        gpu=GPU,
    params:
        cases=training_cases,
        training=settings_of("finetuning"),
        fem=config["fem"],
        seed=SEED,
        code=code_of("finetune"),
    message:
        "Adapt {wildcards.method} to the post-operative skins of fold {wildcards.fold}"
    script:
        "../scripts/finetune.py"


rule networks:
    input:
        expand(
            "<results>/folds/{fold}/{method}/network.pt",
            fold=STUDY.held_out,
            method=STUDY.learned,
        ),
    message:
        "All networks are trained"
