"""Makes a method's predictions of some patients, or of one patient by what every fold has trained."""

import logging
from collections.abc import Mapping, Sequence
from functools import lru_cache

from pinnochio.json_text import read_stored_json
from pinnochio.logs import attach_log
from pinnochio.mechanics.lift import Lift
from pinnochio.methods.protocol import Planned
from pinnochio.model.patient import PatientModel
from pinnochio.model.predictions import write_predictions
from pinnochio.plans.plan import Plan
from pinnochio.references import resolve
from pinnochio.training.device import device_of


def predict(
    predictor: str,
    settings: Mapping,
    names: Sequence[str],
    cases: Sequence[str],
    models: Sequence[str],
    plans: Sequence[str],
    trained: Sequence[str],
    lifts: Sequence[str],
    truths: Sequence[str],
    covariates: Sequence[str],
    device: str,
    threads: int,
    predictions: str,
    warm: bool = True,
) -> None:
    """Write the prediction of each of `names`, cases or folds, by the method of a `predictor`; FloatingPointError if a
    field is not finite.

    settings: values of the sections that it reads. cases and the files have one entry per name, or one for all: plans
    and models; what a fold has trained, if anything; lifts of a method that has one; files of the virtual truth for a
    bound; what else is known, for a method that reads it. warm: whether the seconds are of warm calls.
    """
    patients = {model: PatientModel.read(model) for model in dict.fromkeys(models)}
    methods, made = {}, {}

    @lru_cache(maxsize=1)  # one patient for all folds, or each once
    def planned(case: str, model: str, plan: str, lift: str | None, truth: str | None, known: str | None) -> Planned:
        return Planned(
            case=case,
            patient=patients[model],
            plan=Plan.read(plan, case),
            lift=Lift.read(lift) if lift else None,
            truth=truth,
            covariates=read_stored_json(known) if known else {},
            warm=warm,
        )

    files = (_each(part, len(names)) for part in (cases, models, plans, trained, lifts, truths, covariates))
    for name, case, model, plan, fitted, lift, truth, known in zip(names, *files, strict=True):
        if fitted not in methods:
            methods[fitted] = resolve(predictor)(settings=settings, trained=fitted, device=device, threads=threads)
        made[name] = prediction = methods[fitted](planned(case, model, plan, lift, truth, known))
        logging.info("%s: %.4f s, and %.3f s for the patient", name, prediction.seconds, prediction.setup_seconds)
    write_predictions(predictions, made)


def _each(values: Sequence[str], count: int) -> list[str | None]:
    """One value per name: as they are, the same for all, or none."""
    return list(values) if len(values) > 1 else count * [next(iter(values), None)]


if __name__ == "__main__":
    attach_log(snakemake.log[0])
    names = ("models", "plans", "trained", "lifts", "truths", "covariates")
    predict(
        predictor=snakemake.params.predictor,
        settings=snakemake.params.settings,
        names=snakemake.params.names,
        cases=snakemake.params.cases,
        **{name: snakemake.input.get(name, []) for name in names},
        device=device_of(snakemake.params.predictor, snakemake.resources.gpu, snakemake.threads),
        threads=snakemake.threads,
        predictions=snakemake.output.predictions,
    )
