# What a finer mesh costs, stage by stage; not part of `all`.

SCALED = [
    STUDY.sized(nodes, "{file}").replace("{case}", next(iter(STUDY.cohort.cases)))
    for nodes in config["scaling"]["nodes"]
]
add_table(
    "scaling",
    "studies.scaling.table",
    title="Cost against nodes",
    caption="What every stage before a plan costs against the nodes of the mesh.",
    files={
        "models": expand(SCALED, file="model.h5"),
        "lifts": expand(SCALED, file="lift_elastic.h5"),
    },
    arguments=NAMED,
)


rule scaling:
    input:
        recorded("scaling"),
    message:
        "What a finer mesh costs is measured"


# Measured by hand: dry runs on made case tables, and trainings (docs/lab/scaling.md).
rule draw_registry:
    input:
        table="results/reference/scaling_patients.csv",
    output:
        picture="<results>/figures/registry.png",
        drawing="<results>/figures/registry.svg",
    log:
        "<logs>/draw_registry.log",
    conda:
        "../../../envs/pinnochio.yaml"
    resources:
        mem_mb=1000,
        runtime=5,
    params:
        module="studies.scaling.figure",
        code=code_of("scripts.tables.render_table", "studies.scaling.figure"),
    message:
        "Draw what a registry costs"
    script:
        "../../../scripts/tables/render_table.py"
