"""Makes what a method learns at once of a fold's training patients: their samples and post-operative skins."""

from collections.abc import Mapping, Sequence
from pathlib import Path

from pinnochio.gathered import gathered_files
from pinnochio.json_text import read_stored_json
from pinnochio.logs import attach_log
from pinnochio.mechanics.settings import FemSettings
from pinnochio.model.patient import PatientModel
from pinnochio.model.postop import PostopSkin
from pinnochio.plans.plan import Plan
from pinnochio.references import resolve
from pinnochio.stages import Stages
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


def fit_once(read: Mapping[str, object], settings: Mapping[str, object], fitted: str) -> None:
    """Nothing is fitted anew where other jobs have made files again of the same content."""
    with Stages(Path(fitted).with_name(".fit.json")) as stages:
        stages(fit, read, {"fitted": fitted}, settings)


if __name__ == "__main__":
    attach_log(snakemake.log[0])
    params, files = snakemake.params, snakemake.input
    read = gathered_files(files, params.cases, "models", "fem_samples", "plans", "postops", "covariates")
    settings = {name: params[name] for name in ("learner", "settings", "cases")}
    fit_once(read=read, settings=settings, fitted=snakemake.output.fitted)
