"""Makes the table of the stability sweep of one patient's model and the block problem."""

from collections.abc import Mapping

import torch
from tqdm import tqdm

from pinnochio.experiments.stability import Sweep
from pinnochio.logs import attach_log
from pinnochio.mechanics.settings import FemSettings
from pinnochio.methods.pinnochio.losses import physics_loss
from pinnochio.methods.pinnochio.patient import LOSS_EXTENSION
from pinnochio.model.patient import PatientModel
from pinnochio.tables.stability import table as stability_table


def stability(
    case: str, model: str, config: Mapping, fem: FemSettings, seed: int, code: str, table: str, document: str
) -> None:
    """Write one row per cell, and the document of the twins; config: section `stability` of the configuration.

    RuntimeError if a cell is wrong.
    """
    sweep = Sweep(
        case=case,
        model=PatientModel.read(model),
        config=config,
        fem=fem,
        extension=LOSS_EXTENSION,
        loss=training_loss,
        seed=seed,
    )
    labels = {"seed": seed, "device": "cpu", "code": code}
    rows = [row | labels for row in tqdm(sweep.rows())]
    stability_table(rows).write(table=table, document=document)


def training_loss(operator, free):
    """The physics loss of the training as a function of the displacement, for free nodes (f,) of a mesh."""
    return lambda displacement: physics_loss(operator, free, displacement)


if __name__ == "__main__":
    attach_log(snakemake.log[0])
    torch.set_num_threads(snakemake.threads)
    stability(
        case=snakemake.params.case,
        model=snakemake.input.model,
        config=snakemake.params.stability,
        fem=FemSettings(**snakemake.params.fem),
        seed=snakemake.params.seed,
        code=snakemake.params.code,
        table=snakemake.output.table,
        document=snakemake.output.document,
    )
