"""Makes the cells of one part of the stability sweep: a family of extremes on the block problem or on one patient."""

from collections.abc import Mapping

from tqdm import tqdm

from pinnochio.columns import write_rows
from pinnochio.logs import attach_log
from pinnochio.mechanics.settings import FemSettings
from pinnochio.model.patient import PatientModel
from studies.stability.sweep import Sweep
from studies.stability.table import STABILITY


def stability(
    family: str,
    case: str,
    way: str,
    model: str | None,
    config: Mapping,
    fem: FemSettings,
    seed: int,
    code: str,
    table: str,
    **predicting: object,
) -> None:
    """Write one row per cell, wrong ones too; config: section `stability` of the configuration.

    model: None for the block; way: direction or axis of the motion, "-" without one; predicting: controls, network and
    corrections, as :class:`Sweep` takes them.
    """
    patient = PatientModel.read(model) if model else None
    sweep = Sweep(family, case, way, patient, config, fem, seed, **predicting)
    labels = {"seed": seed, "device": "cpu", "code": code}
    write_rows([row | labels for row in tqdm(sweep.rows())], table, STABILITY)


if __name__ == "__main__":
    attach_log(snakemake.log[0])
    stability(
        **{
            name: snakemake.params[name]
            for name in ("family", "case", "way", "seed", "code", "controls", "corrections")
        },
        **{name: next(iter(snakemake.input[name]), None) for name in ("model", "network")},
        config=snakemake.params.stability,
        fem=FemSettings(**snakemake.params.fem),
        table=snakemake.output.table,
    )
