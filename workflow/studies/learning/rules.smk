# What more training patients are worth; not part of `all`.

from studies.learning.inputs import Learning

LEARNING = Learning(
    section=config["learning"],
    training={fold: len(STUDY.folds.training(fold)) for fold in STUDY.folds.held_out},
    methods=STUDY.methods.used,
)
add_table(
    "learning",
    "studies.learning.table",
    title="Error against training patients",
    caption="What more operated patients to learn from are worth: the same held-out patients, predicted after training on some of the others and on all.",
    figure="studies.learning.figure",
    files=LEARNING.metrics,
    arguments=NAMED
    | {
        "methods": config["learning"]["methods"],
        "untaught": LEARNING.untaught,
        "patients": list(LEARNING.folds),
        "seed": SEED,
    },
)


rule learning:
    input:
        recorded("learning"),
        "<results>/figures/learning.png",
    message:
        "The learning curve is measured"
