"""Makes the Newton corrections of a network's predictions of a fold's held-out patients."""

import logging
from collections.abc import Mapping, Sequence
from dataclasses import replace

from pinnochio.errors import InputError
from pinnochio.logs import attach_log
from pinnochio.mechanics.settings import FemSettings
from pinnochio.mechanics.solvers.newton_corrections import Finish
from pinnochio.model.patient import PatientModel
from pinnochio.model.predictions import read_prediction, write_predictions


def correct(
    cases: Sequence[str],
    predictions: str,
    models: Sequence[str],
    fem: FemSettings,
    threads: int,
    corrected: Mapping[int, str],
) -> None:
    """Write each case's field after so many Newton corrections of the network's to the file that `corrected` names.

    0: the network's field after the inversion repair, with which every correction begins. The load that a method
    declares stays on: equilibrium is with it.

    One pass makes them all; where it meets the tolerance earlier, larger numbers hold the same field. The seconds are
    those of the prediction, with these corrections in place of its. The first case is corrected once more beforehand,
    so that no timing holds the loading of compiled code.
    """
    fields: dict[int, dict] = {count: {} for count in corrected}
    for case, path in zip([cases[0], *cases], [models[0], *models], strict=True):
        patient, prediction = PatientModel.read(path), read_prediction(predictions, case)
        if prediction.boundary is None:
            raise InputError(
                case, predictions, "the method gives no interface", "name learned methods in 'corrections'"
            )
        finish = Finish(patient, fem, max(corrected))
        states, repair = finish.all(prediction.raw, prediction.boundary, prediction.forces, tolerance=fem.tolerance)
        already = states[min(prediction.iterations, len(states) - 1)].seconds
        for count in corrected:
            made = min(count, len(states) - 1)
            fields[count][case] = replace(
                prediction,
                displacement=states[made].displacement,
                seconds=prediction.seconds + states[made].seconds - already,
                threads=threads,
                iterations=made,
                repaired=repair.elements,
                damping=repair.damping,
            )
        logging.info("%s: residuals %s", case, " ".join(f"{state.residual:.1e}" for state in states))
    for count, path in corrected.items():
        write_predictions(path, fields[count])


if __name__ == "__main__":
    attach_log(snakemake.log[0])
    correct(
        cases=snakemake.params.cases,
        predictions=snakemake.input.predictions,
        models=snakemake.input.models,
        fem=FemSettings(**snakemake.params.fem),
        threads=snakemake.threads,
        corrected=dict(zip(snakemake.params.corrections, snakemake.output.corrected, strict=True)),
    )
