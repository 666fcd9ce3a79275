"""Makes the trade-off's rows of finite elements on one patient, and the reference that all fields are judged by."""

import logging
from collections.abc import Mapping, Sequence
from dataclasses import replace

from pinnochio.columns import write_rows
from pinnochio.logs import attach_log
from pinnochio.mechanics.settings import FemSettings
from pinnochio.model.patient import PatientModel
from pinnochio.model.predictions import write_predictions
from pinnochio.plans.plan import Plan
from studies.tradeoff.cases import TRADEOFF_CASES
from studies.tradeoff.measuring import Reference, judge, predict_fem
from studies.tradeoff.settings import Setting

BEFOREHAND = 0.05  # s; a solve begun and stopped, so that no timing holds the loading of compiled code


def measure_fem(
    case: str,
    models: Mapping[int, str],
    plan: str,
    settings: Sequence[Setting],
    nodes: int,
    fem: FemSettings,
    threads: int,
    rows: str,
    reference: str,
) -> None:
    """Write one row per setting, and the reference's field; models: file by number of nodes.

    settings: the reference, the elastic one and others; nodes: of the study. Where the reference does not converge
    the rows have no distance from it.
    """
    patients = {size: PatientModel.read(path) for size, path in models.items()}
    motion, solution, judgements = Plan.read(plan, case), None, []
    predict_fem(settings[1], patients[nodes], motion, fem, threads)
    predict_fem(settings[0], patients[nodes], motion, fem, threads)
    newton = replace(fem, time_limit=BEFOREHAND, kept_factors=False)
    predict_fem(settings[0], patients[nodes], motion, newton, threads)
    for number, setting in enumerate(settings):
        # The reference, first of all, is given the work that it needs.
        limit = fem.max_systems if number else 20 * fem.max_systems
        patient = patients[setting.nodes]
        prediction = predict_fem(setting, patient, motion, replace(fem, max_systems=limit), threads)
        if number == 0:
            write_predictions(reference, {case: prediction})
            solution = Reference.of(patient, prediction)
            if solution is None:
                logging.warning("the reference did not converge: %s", prediction.reason)
        judgements.append(judge(setting, case, patient, prediction, solution, fem))
        logging.info("%(method)s, %(parameter)s %(value)s: %(seconds).3f s, %(face_error).3f mm", judgements[-1])
    write_rows(judgements, rows, TRADEOFF_CASES)


if __name__ == "__main__":
    attach_log(snakemake.log[0])
    measure_fem(
        case=snakemake.wildcards.case,
        models=dict(zip(snakemake.params.sizes, snakemake.input.models, strict=True)),
        plan=snakemake.input.plan,
        settings=[Setting(**values) for values in snakemake.params.settings],
        nodes=snakemake.params.nodes,
        fem=FemSettings(**snakemake.params.fem),
        threads=snakemake.threads,
        **dict(snakemake.output.items()),
    )
