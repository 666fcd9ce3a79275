configfile: "config/config.yaml"


report: "workflow/report/workflow.rst"


pathvars:
    logs="<results>/logs",
    benchmarks="<results>/benchmarks",


include: "workflow/common.smk"
include: "workflow/tables.smk"
include: "rules/virtual.smk"
include: "rules/patient.smk"
include: "rules/fem.smk"
include: "rules/training.smk"
include: "rules/curves.smk"
include: "rules/prediction.smk"
include: "rules/tables.smk"
include: "rules/corrections.smk"
include: "rules/tradeoff.smk"
include: "rules/uncertainty.smk"
include: "rules/patients.smk"
include: "rules/invert.smk"
include: "rules/stability.smk"
include: "rules/scene.smk"
include: "rules/scaling.smk"
include: "rules/report.smk"


wildcard_constraints:
    **STUDY.wildcards,


rule all:
    default_target: True
    input:
        rules.tables.input,
        rules.quality.input,
        rules.unscanned.input,
        rules.cost.input,
        "<results>/provenance.json",
    message:
        "The study is done: see {config[pathvars][results]}/tables"
