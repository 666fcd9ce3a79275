"""Makes one calibration patient's rows: how far off sliding finite elements are at each scale of the changes."""

import json
from pathlib import Path

import pandas as pd

from pinnochio.columns import write_csv
from pinnochio.logs import attach_log
from pinnochio.model.surfaces import bone_surface
from pinnochio.virtual.outcome import Operation
from pinnochio.virtual.reality import CASE, measure


def measure_reality(
    case: str,
    inputs: dict[str, str],
    outcome: dict,
    label_values: dict[str, int],
    segments: tuple[str, ...],
    samples: int,
    seed: int,
    table: str,
) -> None:
    """inputs: segmentation, plan, landmarks, anatomy, covariates; samples: area-uniform ones per surface; the rest as
    in the outcome's stage."""
    operation = Operation.read(
        case=case, inputs=inputs, labels=label_values, segments=segments, outcome=outcome, seed=seed
    )
    head = operation.head
    bone = bone_surface(
        labels=head.labels,
        spacing=head.spacing,
        origin=head.origin,
        segments=segments,
        edge_mm=outcome["mesh"]["bone_edge"],
    )
    anatomy = json.loads(Path(inputs["anatomy"]).read_text(encoding="utf-8"))
    rows = measure(operation=operation, anatomy=anatomy, effects=outcome["effects"], bone=bone, samples=samples)
    write_csv(pd.DataFrame(rows), table, CASE)


if __name__ == "__main__":
    attach_log(snakemake.log[0])
    measure_reality(
        case=snakemake.wildcards.case,
        inputs=dict(snakemake.input.items()),
        outcome=snakemake.params.outcome,
        label_values=snakemake.params.labels,
        segments=tuple(snakemake.params.segments),
        samples=snakemake.params.samples,
        seed=snakemake.params.seed,
        table=snakemake.output.table,
    )
