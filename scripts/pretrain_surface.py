"""Makes a fold's pretrained surface network of the training patients' finite-element fields."""

from collections.abc import Sequence

from pinnochio.logs import attach_log
from pinnochio.methods.pinnochio.learner import CaseFiles
from pinnochio.methods.surface.learner import pretrain_fold
from pinnochio.methods.surface.settings import SurfaceSettings, training_settings
from pinnochio.seeds import derive_seed
from pinnochio.training.device import choose_device
from pinnochio.training.settings import TrainingSettings


def pretrain_surface(
    cases: Sequence[str],
    models: Sequence[str],
    fem_samples: Sequence[str],
    network: SurfaceSettings,
    training: TrainingSettings,
    seed: int,
    device: str,
    outputs: dict[str, str],
) -> None:
    """Train on the given cases and nothing else; outputs names the files network and history."""
    files = [CaseFiles(*own[:2], fem_samples=own[2]) for own in zip(cases, models, fem_samples, strict=True)]
    pretrain_fold(
        files, network, training, seed=seed, device=device, out=outputs["network"], history=outputs["history"]
    )


if __name__ == "__main__":
    attach_log(snakemake.log[0])
    pretrain_surface(
        cases=snakemake.params.cases,
        models=snakemake.input.models,
        fem_samples=snakemake.input.fem_samples,
        network=SurfaceSettings(**snakemake.params.network),
        training=training_settings(snakemake.params.training),
        seed=derive_seed(snakemake.params.seed, "pretrain", f"{snakemake.wildcards.fold}/{snakemake.wildcards.method}"),
        device=choose_device(snakemake.resources.gpu, snakemake.threads),
        outputs=dict(snakemake.output.items()),
    )
