# Training comes first where it can, pretraining before all: short jobs fill the cores at the end.
rule pretrain:
    input:
        models=of_training("<results>/cases/{case}/model.h5"),
        lifts=lifts_of(training_cases),
        fem_samples=of_training("<results>/cases/{case}/fem_samples.h5"),
    output:
        network="<results>/folds/{fold}/{method}/pretrained.pt",
        history="<results>/folds/{fold}/{method}/pretraining.csv",
    log:
        "<logs>/pretrain/{fold}_{method}.log",
    benchmark:
        "<benchmarks>/pretrain/{fold}_{method}.tsv"
    wildcard_constraints:
        method="|".join(PRETRAINED) or "none",
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
        module=module_of("learner"),
        settings=settings_of("network", "pretraining", "fem"),
        seed=SEED,
        code=code_with_method("pretrain", "learner"),
    message:
        "Pretrain {wildcards.method} on the finite-element samples of fold {wildcards.fold}"
    script:
        "../scripts/pretrain.py"


rule finetune:
    input:
        network=pretrained,
        models=of_training("<results>/cases/{case}/model.h5"),
        lifts=lifts_of(training_cases),
        plans=of_training("<results>/cases/{case}/plan.json"),
        postops=of_training("<results>/cases/{case}/postop.h5"),
    output:
        network="<results>/folds/{fold}/{method}/network.pt",
        history="<results>/folds/{fold}/{method}/finetuning.csv",
    log:
        "<logs>/finetune/{fold}_{method}.log",
    benchmark:
        "<benchmarks>/finetune/{fold}_{method}.tsv"
    wildcard_constraints:
        method="|".join(SETTINGS) or "none",
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
        module=module_of("learner"),
        settings=settings_of("network", "finetuning", "fem"),
        seed=SEED,
        code=code_with_method("finetune", "learner"),
    message:
        "Adapt {wildcards.method} to the post-operative skins of fold {wildcards.fold}"
    script:
        "../scripts/finetune.py"


rule fit:
    input:
        models=of_training("<results>/cases/{case}/model.h5"),
        fem_samples=of_training("<results>/cases/{case}/fem_samples.h5"),
        plans=of_training("<results>/cases/{case}/plan.json"),
        postops=of_training("<results>/cases/{case}/postop.h5"),
    output:
        fitted="<results>/folds/{fold}/{method}/fitted.h5",
    log:
        "<logs>/fit/{fold}_{method}.log",
    benchmark:
        "<benchmarks>/fit/{fold}_{method}.tsv"
    wildcard_constraints:
        method="|".join(FITTED),
    conda:
        "../envs/pinnochio.yaml"
    threads: 1
    resources:
        mem_mb=4000,
        runtime=30,
    params:
        cases=training_cases,
        module=module_of("predictor"),
        code=code_with_method("fit", "predictor"),
    message:
        "Fit {wildcards.method} to the training patients of fold {wildcards.fold}"
    script:
        "../scripts/fit.py"


rule networks:
    input:
        expand(
            "<results>/folds/{fold}/{method}/network.pt", fold=HELD_OUT, method=LEARNED
        ),
    message:
        "All networks are trained"
