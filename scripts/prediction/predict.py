"""Makes a method's predictions of some patients, or of one patient by what every fold has trained."""

import logging
from collections.abc import Mapping, Sequence
from dataclasses import replace
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
    plans: Sequence[Sequence[str]],
    trained: Sequence[str],
    lifts: Sequence[str],
    truths: Sequence[str],
    covariates: Sequence[str],
    device: str,
    threads: int,
    predictions: Sequence[str],
    warm: bool = True,
) -> None:
    """Write the prediction of each of `names`, cases or folds, by the method of a `predictor`; FloatingPointError if a
    field is not finite.

    settings: values of the sections that it reads. cases and the files have one entry per name, or one for all: models;
    what a fold has trained, if anything; lifts of a method that has one; files of the virtual truth for a bound; what
    else is known, for a method that reads it. plans: such files of each motion that has a file of `predictions`; what
    belongs to a patient serves all motions. warm: whether the seconds are of warm calls.
    """
    patients = {model: PatientModel.read(model) for model in dict.fromkeys(models)}
    methods, made = {}, [{} for _ in predictions]

    @lru_cache(maxsize=1)  # one patient for all folds, or each once
    def planned(
        case: str, model: str, lift: str | None, truth: str | None, known: str | None, *plans: str
    ) -> list[Planned]:
        first = Planned(
            case=case,
            patient=patients[model],
            plan=Plan.read(plans[0], case),
            lift=Lift.read(lift) if lift else None,
            truth=truth,
            covariates=read_stored_json(known) if known else {},
            warm=warm,
        )
        # A further motion finds warm what the first one's call has loaded.
        rest = [replace(first, plan=Plan.read(plan, case), warm=False) for plan in plans[1:]]
        return [first, *rest]

    files = (_each(part, len(names)) for part in (cases, trained, models, lifts, truths, covariates, *plans))
    for name, case, fitted, *of_patient in zip(names, *files, strict=True):
        if fitted not in methods:
            methods[fitted] = resolve(predictor)(settings=settings, trained=fitted, device=device, threads=threads)
        for motion, one in zip(made, planned(case, *of_patient), strict=True):
            motion[name] = prediction = methods[fitted](one)
            logging.info("%s: %.4f s, and %.3f s for the patient", name, prediction.seconds, prediction.setup_seconds)
    for file, motion in zip(predictions, made, strict=True):
        write_predictions(file, motion)


def _each(values: Sequence[str], count: int) -> list[str | None]:
    """One value per name: as they are, the same for all, or none."""
    return list(values) if len(values) > 1 else count * [next(iter(values), None)]


if __name__ == "__main__":
    attach_log(snakemake.log[0])
    names = ("models", "trained", "lifts", "truths", "covariates")
    predict(
        **{name: snakemake.params[name] for name in ("predictor", "settings", "names", "cases")},
        **{name: snakemake.input.get(name, []) for name in names},
        plans=[snakemake.input.plans],
        device=device_of(snakemake.params.predictor, snakemake.resources.gpu, snakemake.threads),
        threads=snakemake.threads,
        predictions=[snakemake.output.predictions],
    )
