# One page of what a study has found; not part of `all`.


# The tissue of one patient from behind, by the networks with and without physics.
rule render_volume:
    input:
        model="<results>/cases/{case}/model.h5",
        predictions=lambda wildcards: expand(
            "<results>/folds/{fold}/{method}/predictions.h5",
            fold=STUDY.folds.by_case[wildcards.case],
            method=INPUTS.report.volumes,
        ),
    output:
        picture=captioned("<results>/figures/{case}_volume.png", "volume"),
    log:
        "<logs>/render_volume/{case}.log",
    wildcard_constraints:
        case=any_of(STUDY.cohort.cases),
    conda:
        "../envs/pinnochio.yaml"
    resources:
        mem_mb=2000,
        runtime=10,
    params:
        methods=INPUTS.report.volumes,
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
            fold=STUDY.folds.first,
            method=STUDY.methods.learned,
        ),
        pictures=expand("<results>/figures/{case}.png", case=INPUTS.report.shown),
        views=expand("<results>/figures/{case}.json", case=INPUTS.report.shown),
        volumes=(
            expand("<results>/figures/{case}_volume.png", case=INPUTS.report.shown)
            if INPUTS.report.volumes
            else []
        ),
        qualities=expand("<results>/cases/{case}/quality.png", case=INPUTS.report.shown),
        cases="<results>/tables/cases.csv" if STUDY.cohort.scanned else [],
        chart="<results>/figures/cases.png" if STUDY.cohort.scanned else [],
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
        cases=INPUTS.report.shown,
        methods=STUDY.methods.compared,
        learned=STUDY.methods.learned,
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
        "<results>/figures/cases.png" if STUDY.cohort.scanned else [],
        expand("<results>/figures/{case}.png", case=INPUTS.report.shown),
    message:
        "The pictures are drawn: see {config[pathvars][results]}/figures"


rule report:
    input:
        rules.write_report.output,
    message:
        "The report is written: see {config[pathvars][results]}/report.html"
