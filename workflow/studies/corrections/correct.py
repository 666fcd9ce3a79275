"""Makes the Newton corrections of a network's predictions of a fold's held-out patients."""

import logging
import time
from collections.abc import Mapping, Sequence
from dataclasses import replace

from pinnochio.errors import InputError
from pinnochio.logs import attach_log
from pinnochio.mechanics.settings import FemSettings
from pinnochio.mechanics.solvers.newton_corrections import Corrector, interface
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
    """Write each case's field after some Newton corrections to the file that `corrected` names for their number.

    The load that a method declares stays on: equilibrium is with it.

    One pass makes them all; where it meets the tolerance earlier, larger numbers hold the same field. The seconds are
    those of the network and of the corrections. The first case is corrected once more beforehand, so that no timing
    holds the loading of compiled code.
    """
    fields: dict[int, dict] = {count: {} for count in corrected}
    for case, path in zip([cases[0], *cases], [models[0], *models], strict=True):
        patient, prediction = PatientModel.read(path), read_prediction(predictions, case)
        if prediction.boundary is None:
            raise InputError(
                case, predictions, "the method gives no interface", "name learned methods in 'corrections'"
            )
        nodes, prescribed = interface(patient, prediction.boundary)
        began = time.perf_counter()
        corrector = Corrector.of(patient, fem, nodes)
        setup = prediction.setup_seconds + time.perf_counter() - began
        states = corrector.corrections(
            start=prediction.displacement,
            prescribed=prescribed,
            steps=max(corrected),
            tolerance=fem.tolerance,
            forces=prediction.forces,
        )
        corrector.close()
        for count in corrected:
            made = min(count, len(states) - 1)
            fields[count][case] = replace(
                prediction,
                displacement=states[made].displacement,
                seconds=prediction.seconds + states[made].seconds,
                setup_seconds=setup,
                threads=threads,
                iterations=prediction.iterations + made,
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
