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
