"""Draws what a clinic would know of a virtual patient beside plan and images."""

import json
from pathlib import Path

from pinnochio.logs import attach_log
from pinnochio.seeds import generator
from pinnochio.virtual.covariates import sample_covariates


def draw_covariates(case: str, anatomy: str, reality: str, seed: int, covariates: str) -> None:
    """anatomy: JSON file of the patient; reality: `virtual.outcome.reality`; covariates: JSON file to write."""
    known = json.loads(Path(anatomy).read_text(encoding="utf-8"))
    sample_covariates(known, reality, generator(seed, "sample_covariates", case)).write(covariates)


if __name__ == "__main__":
    attach_log(snakemake.log[0])
    draw_covariates(
        case=snakemake.wildcards.case,
        anatomy=snakemake.input.anatomy,
        reality=snakemake.params.reality,
        seed=snakemake.params.seed,
        covariates=snakemake.output.covariates,
    )
