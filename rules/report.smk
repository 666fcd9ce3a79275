# One page of what a study has found; not part of `all`.


# The tissue of one patient from behind, by the networks with and without physics.
rule render_volume:
    input:
        model="<results>/cases/{case}/model.h5",
        predictions=lambda wildcards: expand(
            "<results>/folds/{fold}/{method}/predictions.h5",
            fold=fold_of(wildcards.case),
            method=VOLUMES,
        ),
    output:
        picture=captioned("<results>/figures/{case}_volume.png", "volume"),
    log:
        "<logs>/render_volume/{case}.log",
    conda:
        "../envs/pinnochio.yaml"
    threads: 1
    resources:
        mem_mb=2000,
        runtime=10,
    params:
        methods=VOLUMES,
        code=code_of("render_volume"),
    message:
        "Draw the tissue of {wildcards.case} from behind"
    script:
        "../scripts/render_volume.py"


rule write_report:
    input:
        tables=tables_of_report,
        figures=figures_of_report,
        curves=expand(
            "<results>/folds/{fold}/{method}/training.png",
            fold=FIRST,
            method=LEARNED,
        ),
        pictures=expand("<results>/figures/{case}.png", case=SHOWN),
        views=expand("<results>/figures/{case}.json", case=SHOWN),
        volumes=(
            expand("<results>/figures/{case}_volume.png", case=SHOWN)
            if VOLUMES
            else []
        ),
        provenance="<results>/provenance.json",
        template="workflow/report/page.html",
        program="workflow/report/view.js",
        captions=expand(
            "workflow/report/{part}.rst", part=[*PARTS, "picture", "volume"]
        ),
    output:
        page="<results>/report.html",
    log:
        "<logs>/write_report.log",
    conda:
        "../envs/pinnochio.yaml"
    threads: 1
    resources:
        mem_mb=2000,
        runtime=10,
    params:
        cases=SHOWN,
        learned=LEARNED,
        code=code_of("write_report"),
    message:
        "Write the report"
    script:
        "../scripts/write_report.py"


rule report:
    input:
        rules.write_report.output,
    message:
        "The report is written: see {config[pathvars][results]}/report.html"
