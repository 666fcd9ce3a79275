"""Makes the table of the stability sweep of one patient's model and the block problem."""

from collections.abc import Mapping

import torch
from tqdm import tqdm

from pinnochio.anatomy.model import PatientModel
from pinnochio.evaluation.stability import Sweep, write_stability
from pinnochio.logs import attach_log
from pinnochio.mechanics.settings import FemSettings
from pinnochio.training.losses import physics_loss
from pinnochio.training.patient import LOSS_EXTENSION


def stability(case: str, model: str, config: Mapping, fem: FemSettings, seed: int, code: str, table: str) -> None:
    """Write one row per cell; config: section `stability` of the configuration. RuntimeError if a cell is wrong."""
    sweep = Sweep(case, PatientModel.read(model), config, fem, LOSS_EXTENSION, training_loss, seed)
    labels = {"seed": seed, "device": "cpu", "code": code}
    write_stability([row | labels for row in tqdm(sweep.rows())], table)


def training_loss(operator, free):
    """The physics loss of the training as a function of the displacement, for free nodes (f,) of a mesh."""
    return lambda displacement: physics_loss(operator, free, displacement)


if __name__ == "__main__":
    attach_log(snakemake.log[0])
    torch.set_num_threads(snakemake.threads)
    stability(
        snakemake.params.case,
        snakemake.input.model,
        snakemake.params.stability,
        FemSettings(**snakemake.params.fem),
        snakemake.params.seed,
        snakemake.params.code,
        snakemake.output.table,
    )
