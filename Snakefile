configfile: f"{workflow.basedir}/config/config.yaml"


report: "workflow/report/workflow.rst"


pathvars:
    logs="<results>/logs",
    benchmarks="<results>/benchmarks",


include: "workflow/common.smk"
include: "workflow/tables.smk"
include: "workflow/studies/cohort_checks/rules.smk"
include: "workflow/studies/design/rules.smk"
include: "workflow/studies/inverse/rules.smk"
include: "workflow/studies/learning/rules.smk"
include: "workflow/studies/planner/rules.smk"
include: "workflow/studies/scaling/rules.smk"
include: "workflow/studies/stability/rules.smk"
include: "workflow/studies/tradeoff/rules.smk"
include: "rules/cohort.smk"
include: "rules/patient.smk"
include: "rules/fem.smk"
include: "rules/training.smk"
include: "rules/prediction.smk"
include: "rules/tables.smk"
include: "rules/patients.smk"
include: "rules/report.smk"


wildcard_constraints:
    **STUDY.wildcards,


rule all:
    default_target: True
    input:
        rules.tables.input,
        table_and_twins("quality"),
        rules.unscanned.input,
        rules.cost.input,
        "<results>/provenance.json",
    message:
        "The study is done: see {config[pathvars][results]}/tables"
