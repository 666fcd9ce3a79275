"""Makes a fold's pretrained surface network of the training patients' finite-element fields."""

from collections.abc import Sequence

from pinnochio.baselines.settings import SurfaceSettings, training_settings
from pinnochio.baselines.stages import pretrain_fold
from pinnochio.logs import attach_log
from pinnochio.seeds import derive_seed
from pinnochio.training.device import choose_device
from pinnochio.training.settings import TrainingSettings
from pinnochio.training.stages import CaseFiles


def pretrain_surface(
    cases: Sequence[str],
    models: Sequence[str],
    teaching: Sequence[str],
    network: SurfaceSettings,
    training: TrainingSettings,
    seed: int,
    device: str,
    outputs: dict[str, str],
) -> None:
    """Train on the given cases and nothing else; outputs names the files network and history."""
    files = [CaseFiles(*own[:2], teaching=own[2]) for own in zip(cases, models, teaching, strict=True)]
    pretrain_fold(
        files, network, training, seed=seed, device=device, out=outputs["network"], history=outputs["history"]
    )


if __name__ == "__main__":
    attach_log(snakemake.log[0])
    pretrain_surface(
        snakemake.params.cases,
        snakemake.input.models,
        snakemake.input.teaching,
        SurfaceSettings(**snakemake.params.network),
        training_settings(snakemake.params.training),
        derive_seed(snakemake.params.seed, "pretrain", f"{snakemake.wildcards.fold}/{snakemake.wildcards.method}"),
        choose_device(snakemake.resources.gpu, snakemake.threads),
        dict(snakemake.output.items()),
    )
