"""Makes a fold's pretrained network of the training patients' finite-element fields."""

from collections.abc import Sequence

from pinnochio.logs import attach_log
from pinnochio.mechanics.settings import FemSettings
from pinnochio.methods.pinnochio.learner import CaseFiles, pretrain_fold
from pinnochio.networks.settings import NetworkSettings
from pinnochio.seeds import derive_seed
from pinnochio.training.device import choose_device
from pinnochio.training.settings import TrainingSettings


def pretrain(
    cases: Sequence[str],
    models: Sequence[str],
    lifts: Sequence[str],
    fem_samples: Sequence[str],
    network: NetworkSettings,
    training: TrainingSettings,
    fem: FemSettings,
    seed: int,
    device: str,
    outputs: dict[str, str],
) -> None:
    """Train on the given cases and nothing else; outputs names the files network and history.

    lifts may be empty for a network without one.
    """
    files = [
        CaseFiles(case, model, lift, fem_samples=fields)
        for case, model, lift, fields in zip(cases, models, lifts or [None] * len(cases), fem_samples, strict=True)
    ]
    pretrain_fold(
        files, network, training, fem, seed=seed, device=device, out=outputs["network"], history=outputs["history"]
    )


if __name__ == "__main__":
    attach_log(snakemake.log[0])
    pretrain(
        cases=snakemake.params.cases,
        models=snakemake.input.models,
        lifts=snakemake.input.get("lifts", []),
        fem_samples=snakemake.input.fem_samples,
        network=NetworkSettings(**snakemake.params.network),
        training=TrainingSettings(**snakemake.params.training),
        fem=FemSettings(**snakemake.params.fem),
        seed=derive_seed(snakemake.params.seed, "pretrain", f"{snakemake.wildcards.fold}/{snakemake.wildcards.method}"),
        device=choose_device(snakemake.resources.gpu, snakemake.threads),
        outputs=dict(snakemake.output.items()),
    )
