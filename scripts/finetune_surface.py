"""Makes a fold's final surface network, of the training patients' post-operative skins."""

from collections.abc import Sequence

from pinnochio.logs import attach_log
from pinnochio.methods.pinnochio.learner import CaseFiles
from pinnochio.methods.surface.learner import finetune_fold
from pinnochio.methods.surface.settings import SurfaceSettings, training_settings
from pinnochio.seeds import derive_seed
from pinnochio.training.device import choose_device
from pinnochio.training.settings import TrainingSettings


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
        cases=snakemake.params.cases,
        models=snakemake.input.models,
        plans=snakemake.input.plans,
        postops=snakemake.input.postops,
        pretrained=snakemake.input.get("network") or None,
        network=SurfaceSettings(**snakemake.params.network),
        training=training_settings(snakemake.params.training),
        seed=derive_seed(snakemake.params.seed, "finetune", f"{snakemake.wildcards.fold}/{snakemake.wildcards.method}"),
        device=choose_device(snakemake.resources.gpu, snakemake.threads),
        outputs=dict(snakemake.output.items()),
    )
