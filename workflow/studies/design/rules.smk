# What each switch of the better network is worth, on the first folds; not part of `all`.

from pinnochio.methods.registry import graph_network
from studies.design.switches import switched

check_networks("design.base", [config["design"]["base"]])
with plainly():
    SWITCHED = switched(config["design"], NETWORKS)
# Methods that the core trains and predicts by like any other.
NETWORKS |= SWITCHED
STUDY.methods.registry.update(
    {
        name: graph_network(name, settings, config["fem"])
        for name, settings in SWITCHED.items()
    }
)
DESIGNED = [config["design"]["base"], *SWITCHED]
add_table(
    "design",
    "studies.design.table",
    title="Switches of PINNOCHIO plus",
    caption="What each switch of the better network is worth, one at a time, on the first folds.",
    files={
        "metrics": expand(
            METRICS,
            fold=list(STUDY.folds.held_out)[: config["design"]["folds"]],
            method=DESIGNED,
        )
    },
    arguments=NAMED | {"variants": {m: NETWORKS[m] for m in DESIGNED}, "seed": SEED},
)


rule design:
    input:
        recorded("design"),
    message:
        "The design study is done"
