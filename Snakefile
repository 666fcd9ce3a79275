configfile: "config/config.yaml"


pathvars:
    logs="<results>/logs",
    benchmarks="<results>/benchmarks",


include: "workflow/common.smk"
include: "rules/virtual.smk"
include: "rules/patient.smk"
include: "rules/fem.smk"
include: "rules/lift.smk"
include: "rules/training.smk"
include: "rules/baselines.smk"
include: "rules/curves.smk"
include: "rules/prediction.smk"
include: "rules/tables.smk"
include: "rules/dial.smk"
include: "rules/design.smk"
include: "rules/uncertainty.smk"
include: "rules/stability.smk"
include: "rules/scene.smk"
include: "rules/cost.smk"


wildcard_constraints:
    case="|".join(CASES),
    fold="|".join(HELD_OUT),
    method="|".join([*METHODS, *SETTINGS]),


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
