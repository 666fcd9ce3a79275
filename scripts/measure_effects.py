"""Makes one patient's rows of the effect table: each effect of the simulated outcome alone, on the outer face."""

import pandas as pd

from pinnochio.columns import write_csv
from pinnochio.logs import attach_log
from pinnochio.model.surfaces import bone_surface, skin_surface
from pinnochio.model.truth import read_truth
from pinnochio.virtual.effects import CASE, measure
from pinnochio.virtual.outcome import Operation


def measure_effects(
    case: str,
    inputs: dict[str, str],
    outcome: dict,
    label_values: dict[str, int],
    segments: tuple[str, ...],
    seed: int,
    table: str,
) -> None:
    """inputs: segmentation, plan, landmarks, anatomy, covariates, truth; the rest as in the outcome's stage."""
    operation = Operation.read(
        case=case, inputs=inputs, labels=label_values, segments=segments, outcome=outcome, seed=seed
    )
    head = operation.head
    skin = skin_surface(head.labels, head.spacing, head.origin)
    bone = bone_surface(
        labels=head.labels,
        spacing=head.spacing,
        origin=head.origin,
        segments=operation.segments,
        edge_mm=outcome["mesh"]["bone_edge"],
    )
    *truth, _ = read_truth(inputs["truth"], case)
    write_csv(pd.DataFrame(measure(operation=operation, skin=skin, bone=bone, truth=tuple(truth))), table, CASE)


if __name__ == "__main__":
    attach_log(snakemake.log[0])
    measure_effects(
        case=snakemake.wildcards.case,
        inputs=dict(snakemake.input.items()),
        outcome=snakemake.params.outcome,
        label_values=snakemake.params.labels,
        segments=tuple(snakemake.params.segments),
        seed=snakemake.params.seed,
        table=snakemake.output.table,
    )
