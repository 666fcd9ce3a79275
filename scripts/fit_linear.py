"""Makes a fold's linear regression of the training patients' finite-element fields and post-operative skins."""

from collections.abc import Sequence

from pinnochio.logs import attach_log
from pinnochio.methods.pca_linear import fit
from pinnochio.methods.pinnochio.learner import CaseFiles, read_fem_samples
from pinnochio.model.patient import PatientModel
from pinnochio.model.postop import PostopSkin
from pinnochio.plans.plan import Plan


def fit_linear(
    cases: Sequence[str],
    models: Sequence[str],
    fem_samples: Sequence[str],
    plans: Sequence[str],
    postops: Sequence[str],
    linear: str,
) -> None:
    """Fit to the given cases and nothing else."""
    files = [CaseFiles(*own[:2], fem_samples=own[2]) for own in zip(cases, models, fem_samples, strict=True)]
    fit(
        [PatientModel.read(model) for model in models],
        [read_fem_samples(own) for own in files],
        [Plan.read(plan, case) for plan, case in zip(plans, cases, strict=True)],
        [PostopSkin.read(postop).surface for postop in postops],
    ).write(linear)


if __name__ == "__main__":
    attach_log(snakemake.log[0])
    fit_linear(
        cases=snakemake.params.cases,
        models=snakemake.input.models,
        fem_samples=snakemake.input.fem_samples,
        plans=snakemake.input.plans,
        postops=snakemake.input.postops,
        linear=snakemake.output.linear,
    )
