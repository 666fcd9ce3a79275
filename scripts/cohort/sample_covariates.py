"""Draws what a clinic would know of a virtual patient beside plan and images."""

from pinnochio.json_text import read_stored_json
from pinnochio.seeds import generator
from pinnochio.virtual.covariates import sample_covariates


def draw_covariates(case: str, anatomy: str, reality: str, seed: int, covariates: str) -> None:
    """anatomy: JSON file of the patient; reality: `virtual.outcome.reality`; covariates: JSON file to write."""
    rng = generator(seed, "sample_covariates", case)
    sample_covariates(read_stored_json(anatomy), reality, rng).write(covariates)
