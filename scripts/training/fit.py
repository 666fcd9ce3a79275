"""Makes what a method learns at once of a fold's training patients: their samples and post-operative skins."""

from collections.abc import Mapping, Sequence

from pinnochio.json_text import read_stored_json
from pinnochio.logs import attach_log
from pinnochio.mechanics.settings import FemSettings
from pinnochio.model.patient import PatientModel
from pinnochio.model.postop import PostopSkin
from pinnochio.plans.plan import Plan
from pinnochio.references import resolve
from pinnochio.training.case_files import read_fem_samples


def fit(
    learner: str,
    cases: Sequence[str],
    models: Sequence[str],
    fem_samples: Sequence[str],
    plans: Sequence[str],
    postops: Sequence[str],
    covariates: Sequence[str],
    settings: Mapping,
    fitted: str,
) -> None:
    """Fit by the function `learner` to the cases and nothing else.

    covariates: empty for a method that does not read them; settings: values of the sections that it reads.
    """
    more = {name: FemSettings(**section) for name, section in settings.items()}
    if covariates:
        more["covariates"] = [read_stored_json(path) for path in covariates]
    resolve(learner)(
        models=[PatientModel.read(path) for path in models],
        fem_samples=[read_fem_samples(path, case) for path, case in zip(fem_samples, cases, strict=True)],
        plans=[Plan.read(path, case) for path, case in zip(plans, cases, strict=True)],
        skins=[PostopSkin.read(path).surface for path in postops],
        **more,
    ).write(fitted)


if __name__ == "__main__":
    attach_log(snakemake.log[0])
    fit(
        learner=snakemake.params.learner,
        cases=snakemake.params.cases,
        models=snakemake.input.models,
        fem_samples=snakemake.input.fem_samples,
        plans=snakemake.input.plans,
        postops=snakemake.input.postops,
        covariates=snakemake.input.get("covariates", []),
        settings=snakemake.params.settings,
        fitted=snakemake.output.fitted,
    )
