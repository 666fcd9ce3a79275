"""Makes a fold's linear regression of the training patients' finite-element fields and post-operative skins."""

from collections.abc import Sequence

from pinnochio.anatomy.model import PatientModel
from pinnochio.anatomy.plan import Plan
from pinnochio.anatomy.postop import PostopSkin
from pinnochio.baselines.linear import fit
from pinnochio.logs import attach_log
from pinnochio.training.stages import CaseFiles, read_teaching


def fit_linear(
    cases: Sequence[str],
    models: Sequence[str],
    teaching: Sequence[str],
    plans: Sequence[str],
    postops: Sequence[str],
    linear: str,
) -> None:
    """Fit to the given cases and nothing else."""
    files = [CaseFiles(*own[:2], teaching=own[2]) for own in zip(cases, models, teaching, strict=True)]
    fit(
        [PatientModel.read(model) for model in models],
        [read_teaching(own) for own in files],
        [Plan.read(plan, case) for plan, case in zip(plans, cases, strict=True)],
        [PostopSkin.read(postop).surface for postop in postops],
    ).write(linear)


if __name__ == "__main__":
    attach_log(snakemake.log[0])
    fit_linear(
        snakemake.params.cases,
        snakemake.input.models,
        snakemake.input.teaching,
        snakemake.input.plans,
        snakemake.input.postops,
        snakemake.output.linear,
    )
