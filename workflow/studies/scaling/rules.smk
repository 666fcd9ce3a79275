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
    files={"models": expand(SCALED, file="model.h5")},
    arguments=NAMED | {"benchmarks": BENCHMARKS},
)
# The benchmark files differ from run to run and are no input; the jobs that write them are asked for.
BEFORE["scaling"] = expand(SCALED, file="lift_elastic.h5")


rule scaling:
    input:
        recorded("scaling"),
    message:
        "What a finer mesh costs is measured"
