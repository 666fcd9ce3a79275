"""Makes one patient's rows of the outcome's deviation from nominal mechanics, place by place."""

import pandas as pd

from pinnochio.columns import write_csv
from pinnochio.logs import attach_log
from pinnochio.model.truth import read_truth
from pinnochio.virtual.learnable import CASE, measure
from pinnochio.virtual.outcome import Operation


def measure_deviation(
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
    *truth, executed = read_truth(inputs["truth"], case)
    rows = measure(operation=operation, truth=tuple(truth), executed=executed)
    write_csv(pd.DataFrame(rows), table, CASE)


if __name__ == "__main__":
    attach_log(snakemake.log[0])
    measure_deviation(
        case=snakemake.wildcards.case,
        inputs=dict(snakemake.input.items()),
        outcome=snakemake.params.outcome,
        label_values=snakemake.params.labels,
        segments=tuple(snakemake.params.segments),
        seed=snakemake.params.seed,
        table=snakemake.output.table,
    )
