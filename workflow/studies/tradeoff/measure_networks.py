"""Makes the trade-off's rows of the learned methods on one patient."""

import logging
from collections.abc import Mapping, Sequence

from pinnochio.columns import write_rows
from pinnochio.logs import attach_log
from pinnochio.mechanics.lift import Lift
from pinnochio.mechanics.settings import FemSettings
from pinnochio.methods.protocol import Planned
from pinnochio.model.patient import PatientModel
from pinnochio.model.predictions import read_prediction
from pinnochio.plans.plan import Plan
from pinnochio.training.device import choose_device
from studies.tradeoff.cases import TRADEOFF_CASES
from studies.tradeoff.measuring import Reference, judge, predict_network
from studies.tradeoff.settings import Setting


def measure_networks(
    case: str,
    settings: Sequence[Setting],
    networks: Mapping[str, str],
    kinds: Mapping[str, str],
    models: Mapping[int, str],
    lifts: Mapping[tuple[str, int], str],
    plan: str,
    reference: tuple[str, int],
    fem: FemSettings,
    device: str,
    threads: int,
    rows: str,
) -> None:
    """Write one row per setting.

    networks: file by method; kinds: its lift; models: file by number of nodes; lifts: by kind and number of nodes;
    reference: its file, and the nodes of its mesh.
    """
    patients = {size: PatientModel.read(path) for size, path in models.items()}
    motion = Plan.read(plan, case)
    solution = Reference.of(patients[reference[1]], read_prediction(reference[0], case))
    judgements = []
    for setting in settings:
        patient, kind = patients[setting.nodes], kinds[setting.method]
        lift = None if kind == "none" else Lift.read(lifts[kind, setting.nodes])
        planned = Planned(case, patient, motion, lift)
        prediction = predict_network(setting, networks[setting.method], planned, fem, device, threads)
        judgements.append(judge(setting, case, patient, prediction, solution, fem))
        logging.info("%(method)s, %(parameter)s %(value)s: %(seconds).3f s, %(face_error).3f mm", judgements[-1])
    write_rows(judgements, rows, TRADEOFF_CASES)


if __name__ == "__main__":
    attach_log(snakemake.log[0])
    measure_networks(
        case=snakemake.wildcards.case,
        settings=[Setting(**values) for values in snakemake.params.settings],
        networks=dict(zip(snakemake.params.methods, snakemake.input.networks, strict=True)),
        kinds=snakemake.params.kinds,
        models=dict(zip(snakemake.params.sizes, snakemake.input.models, strict=True)),
        lifts=dict(zip(snakemake.params.lifts, snakemake.input.lifts, strict=True)),
        plan=snakemake.input.plan,
        reference=(snakemake.input.reference, snakemake.params.reference_nodes),
        fem=FemSettings(**snakemake.params.fem),
        device=choose_device(snakemake.resources.gpu, snakemake.threads),
        threads=snakemake.threads,
        rows=snakemake.output.rows,
    )
