"""Makes a method's predictions of some patients."""

import logging
from collections.abc import Mapping, Sequence

from pinnochio.json_text import read_stored_json
from pinnochio.mechanics.lift import Lift
from pinnochio.methods.protocol import Planned
from pinnochio.model.patient import PatientModel
from pinnochio.model.predictions import write_predictions
from pinnochio.plans.plan import Plan
from pinnochio.references import resolve


def predict(
    predictor: str,
    settings: Mapping,
    trained: str | None,
    cases: Sequence[str],
    models: Sequence[str],
    lifts: Sequence[str],
    plans: Sequence[str],
    truths: Sequence[str],
    covariates: Sequence[str],
    device: str,
    threads: int,
    predictions: str,
) -> None:
    """Predict each case by the method of a `predictor`; FloatingPointError if a field is not finite.

    settings: values of the sections that it reads; trained: file of what a fold trained, None where nothing
    is; lifts may be empty for a method without one; truths, files of the virtual truth, are empty for all but a bound,
    covariates for a method that does not read them.
    """
    method = resolve(predictor)(settings=settings, trained=trained, device=device, threads=threads)
    made = {}
    nothing = [None] * len(cases)
    files = cases, models, lifts or nothing, plans, truths or nothing, covariates or nothing
    for case, model, lift, plan, truth, known in zip(*files, strict=True):
        planned = Planned(
            case=case,
            patient=PatientModel.read(model),
            plan=Plan.read(plan, case),
            lift=Lift.read(lift) if lift else None,
            truth=truth,
            covariates=read_stored_json(known) if known else {},
        )
        made[case] = prediction = method(planned)
        logging.info("%s: %.4f s, and %.3f s for the patient", case, prediction.seconds, prediction.setup_seconds)
    write_predictions(predictions, made)
