"""Makes a fold's final surface network, of the training patients' post-operative skins."""

from collections.abc import Sequence

from pinnochio.baselines.settings import SurfaceSettings, training_settings
from pinnochio.baselines.stages import finetune_fold
from pinnochio.logs import attach_log
from pinnochio.seeds import derive_seed
from pinnochio.training.device import choose_device
from pinnochio.training.settings import TrainingSettings
from pinnochio.training.stages import CaseFiles


def finetune_surface(
    cases: Sequence[str],
    models: Sequence[str],
    plans: Sequence[str],
    postops: Sequence[str],
    pretrained: str | None,
    network: SurfaceSettings,
    training: TrainingSettings,
    seed: int,
    device: str,
    outputs: dict[str, str],
) -> None:
    """Train the network at `pretrained`, or a new one; outputs names the files network and history."""
    files = [
        CaseFiles(case, model, plan=plan, postop=postop)
        for case, model, plan, postop in zip(cases, models, plans, postops, strict=True)
    ]
    finetune_fold(
        files,
        pretrained,
        network,
        training,
        seed=seed,
        device=device,
        out=outputs["network"],
        history=outputs["history"],
    )


if __name__ == "__main__":
    attach_log(snakemake.log[0])
    finetune_surface(
        snakemake.params.cases,
        snakemake.input.models,
        snakemake.input.plans,
        snakemake.input.postops,
        snakemake.input.get("network") or None,
        SurfaceSettings(**snakemake.params.network),
        training_settings(snakemake.params.training),
        derive_seed(snakemake.params.seed, "finetune", f"{snakemake.wildcards.fold}/{snakemake.wildcards.method}"),
        choose_device(snakemake.resources.gpu, snakemake.threads),
        dict(snakemake.output.items()),
    )
