# What PINNOCHIO is compared with beside finite elements: networks on surfaces, and floors.


rule pretrain_surface:
    input:
        models=STUDY.of_training("<results>/cases/{case}/model.h5"),
        fem_samples=STUDY.of_training("<results>/cases/{case}/fem_samples.h5"),
    output:
        network="<results>/folds/{fold}/{method}/pretrained.pt",
        history="<results>/folds/{fold}/{method}/pretraining.csv",
    log:
        "<logs>/pretrain_surface/{fold}_{method}.log",
    benchmark:
        "<benchmarks>/pretrain/{fold}_{method}.tsv"
    wildcard_constraints:
        method="|".join(name for name in SURFACE if "pretraining" in SURFACE[name]),
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
        seed=SEED,
        code=code_of("pretrain_surface"),
    message:
        "Pretrain {wildcards.method} on the finite-element fields of fold {wildcards.fold}"
    script:
        "../scripts/pretrain_surface.py"


rule finetune_surface:
    input:
        network=lambda wildcards: (
            "<results>/folds/{fold}/{method}/pretrained.pt"
            if "pretraining" in SURFACE[wildcards.method]
            else []
        ),
        models=STUDY.of_training("<results>/cases/{case}/model.h5"),
        plans=STUDY.of_training("<results>/cases/{case}/plan.json"),
        postops=STUDY.of_training("<results>/cases/{case}/postop.h5"),
    output:
        network="<results>/folds/{fold}/{method}/network.pt",
        history="<results>/folds/{fold}/{method}/finetuning.csv",
    log:
        "<logs>/finetune_surface/{fold}_{method}.log",
    benchmark:
        "<benchmarks>/finetune/{fold}_{method}.tsv"
    wildcard_constraints:
        method="|".join(SURFACE),
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
        network=settings_of("network"),
        training=settings_of("finetuning"),
        seed=SEED,
        code=code_of("finetune_surface"),
    message:
        "Train {wildcards.method} on the post-operative skins of fold {wildcards.fold}"
    script:
        "../scripts/finetune_surface.py"


rule predict_surface:
    input:
        network="<results>/folds/{fold}/{method}/network.pt",
        models=STUDY.of_held_out("<results>/cases/{case}/model.h5"),
        plans=STUDY.of_held_out("<results>/cases/{case}/plan.json"),
    output:
        predictions="<results>/folds/{fold}/{method}/predictions.h5",
    log:
        "<logs>/predict_surface/{fold}_{method}.log",
    benchmark:
        "<benchmarks>/predict_surface/{fold}_{method}.tsv"
    wildcard_constraints:
        method="|".join(SURFACE),
    conda:
        "../envs/pinnochio.yaml"
    threads: 1
    resources:
        mem_mb=4000,
        runtime=20,
        gpu=GPU,
    params:
        cases=held_out,
        code=code_of("predict_surface"),
    message:
        "Predict fold {wildcards.fold} by {wildcards.method}"
    script:
        "../scripts/predict_surface.py"


rule fit_linear:
    input:
        models=STUDY.of_training("<results>/cases/{case}/model.h5"),
        fem_samples=STUDY.of_training("<results>/cases/{case}/fem_samples.h5"),
        plans=STUDY.of_training("<results>/cases/{case}/plan.json"),
        postops=STUDY.of_training("<results>/cases/{case}/postop.h5"),
    output:
        linear="<results>/folds/{fold}/pca_linear/linear.h5",
    log:
        "<logs>/fit_linear/{fold}.log",
    benchmark:
        "<benchmarks>/fit_linear/{fold}.tsv"
    conda:
        "../envs/pinnochio.yaml"
    threads: 1
    resources:
        mem_mb=4000,
        runtime=30,
    params:
        cases=training_cases,
        code=code_of("fit_linear"),
    message:
        "Fit the linear regression of fold {wildcards.fold}"
    script:
        "../scripts/fit_linear.py"


rule predict_rule:
    input:
        linear=lambda wildcards: (
            "<results>/folds/{fold}/pca_linear/linear.h5"
            if wildcards.method == "pca_linear"
            else []
        ),
        models=STUDY.of_held_out("<results>/cases/{case}/model.h5"),
        plans=STUDY.of_held_out("<results>/cases/{case}/plan.json"),
    output:
        predictions="<results>/folds/{fold}/{method}/predictions.h5",
    log:
        "<logs>/predict_rule/{fold}_{method}.log",
    benchmark:
        "<benchmarks>/predict_rule/{fold}_{method}.tsv"
    wildcard_constraints:
        method="ratio|pca_linear",
    conda:
        "../envs/pinnochio.yaml"
    threads: 1
    resources:
        mem_mb=2000,
        runtime=10,
    params:
        cases=held_out,
        code=code_of("predict_rule"),
    message:
        "Predict fold {wildcards.fold} by {wildcards.method}"
    script:
        "../scripts/predict_rule.py"


rule predict_elastic:
    input:
        models=lambda wildcards: model_of(STUDY.held_out[wildcards.fold], "elastic"),
        plans=STUDY.of_held_out("<results>/cases/{case}/plan.json"),
    output:
        predictions="<results>/folds/{fold}/elastic/predictions.h5",
    log:
        "<logs>/predict_elastic/{fold}.log",
    benchmark:
        "<benchmarks>/predict_elastic/{fold}.tsv"
    conda:
        "../envs/pinnochio.yaml"
    threads: 1
    resources:
        mem_mb=4000,
        runtime=20,
    params:
        cases=held_out,
        fem=config["fem"],
        code=code_of("predict_elastic"),
    message:
        "Predict fold {wildcards.fold} by linear elasticity"
    script:
        "../scripts/predict_elastic.py"
