"""Makes a fold's final network: the pretrained one adapted to the training patients' post-operative skins."""

from collections.abc import Sequence

from pinnochio.logs import attach_log
from pinnochio.mechanics.settings import FemSettings
from pinnochio.methods.pinnochio.learner import CaseFiles, finetune_fold
from pinnochio.seeds import derive_seed
from pinnochio.training.device import choose_device
from pinnochio.training.settings import TrainingSettings


def finetune(
    cases: Sequence[str],
    models: Sequence[str],
    lifts: Sequence[str],
    plans: Sequence[str],
    postops: Sequence[str],
    pretrained: str,
    training: TrainingSettings,
    fem: FemSettings,
    seed: int,
    device: str,
    outputs: dict[str, str],
) -> None:
    """Adapt the network at `pretrained` to the given cases; outputs names the files network and history.

    lifts may be empty for a network without one.
    """
    files = [
        CaseFiles(case, model, lift, plan=plan, postop=postop)
        for case, model, lift, plan, postop in zip(
            cases, models, lifts or [None] * len(cases), plans, postops, strict=True
        )
    ]
    finetune_fold(
        files, pretrained, training, fem, seed=seed, device=device, out=outputs["network"], history=outputs["history"]
    )


if __name__ == "__main__":
    attach_log(snakemake.log[0])
    finetune(
        cases=snakemake.params.cases,
        models=snakemake.input.models,
        lifts=snakemake.input.get("lifts", []),
        plans=snakemake.input.plans,
        postops=snakemake.input.postops,
        pretrained=snakemake.input.network,
        training=TrainingSettings(**snakemake.params.training),
        fem=FemSettings(**snakemake.params.fem),
        seed=derive_seed(snakemake.params.seed, "finetune", f"{snakemake.wildcards.fold}/{snakemake.wildcards.method}"),
        device=choose_device(snakemake.resources.gpu, snakemake.threads),
        outputs=dict(snakemake.output.items()),
    )
