# One page of what a study has found; not part of `all`.


# The tissue of one patient from behind, by the networks with and without physics.
rule render_volume:
    input:
        model="<results>/cases/{case}/model.h5",
        predictions=lambda wildcards: expand(
            "<results>/folds/{fold}/{method}/predictions.h5",
            fold=STUDY.fold_of(wildcards.case),
            method=STUDY.volumes,
        ),
    output:
        picture=captioned("<results>/figures/{case}_volume.png", "volume"),
    log:
        "<logs>/render_volume/{case}.log",
    conda:
        "../envs/pinnochio.yaml"
    resources:
        mem_mb=2000,
        runtime=10,
    params:
        methods=STUDY.volumes,
        code=code_of("scripts.report.render_volume"),
    message:
        "Draw the tissue of {wildcards.case} from behind"
    script:
        "../scripts/report/render_volume.py"


with plainly():
    REPORTED = reported()


rule write_report:
    input:
        tables=expand("<results>/tables/{part}.html", part=REPORTED),
        figures=expand(
            "<results>/figures/{part}.png",
            part=[part for part in REPORTED if part in FIGURES],
        ),
        curves=expand(
            "<results>/folds/{fold}/{method}/training.png",
            fold=STUDY.first_fold,
            method=STUDY.learned,
        ),
        pictures=expand("<results>/figures/{case}.png", case=STUDY.shown),
        views=expand("<results>/figures/{case}.json", case=STUDY.shown),
        volumes=(
            expand("<results>/figures/{case}_volume.png", case=STUDY.shown)
            if STUDY.volumes
            else []
        ),
        qualities=expand("<results>/cases/{case}/quality.png", case=STUDY.cases),
        cases="<results>/tables/cases.csv" if STUDY.scanned else [],
        chart="<results>/figures/cases.png" if STUDY.scanned else [],
        provenance="<results>/provenance.json",
    output:
        page="<results>/report.html",
    log:
        "<logs>/write_report.log",
    conda:
        "../envs/pinnochio.yaml"
    resources:
        mem_mb=2000,
        runtime=10,
    params:
        cases=STUDY.shown,
        everyone=list(STUDY.cases),
        methods=STUDY.compared,
        learned=STUDY.learned,
        titles=REPORTED,
        captions={part: caption(part) for part in [*REPORTED, "picture", "volume"]},
        code=code_of("scripts.report.write_report"),
    message:
        "Write the report"
    script:
        "../scripts/report/write_report.py"


# Pictures of what a study has found.
rule figures:
    input:
        "<results>/figures/cases.png" if STUDY.scanned else [],
        expand("<results>/figures/{case}.png", case=STUDY.shown),
    message:
        "The pictures are drawn: see {config[pathvars][results]}/figures"


rule report:
    input:
        rules.write_report.output,
    message:
        "The report is written: see {config[pathvars][results]}/report.html"
