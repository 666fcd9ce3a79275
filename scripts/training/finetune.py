"""Makes a fold's final network: the pretrained one, or a new one, adapted to the training patients' outcomes."""

from collections.abc import Mapping, Sequence
from pathlib import Path

from pinnochio.gathered import gathered_files
from pinnochio.logs import attach_log
from pinnochio.references import resolve
from pinnochio.seeds import derive_seed
from pinnochio.stages import Stages
from pinnochio.training.case_files import case_files
from pinnochio.training.device import choose_device
from pinnochio.training.fold import train_fold


def finetune(
    learner: str,
    settings: Mapping,
    cases: Sequence[str],
    models: Sequence[str],
    lifts: Sequence[str],
    plans: Sequence[str],
    postops: Sequence[str],
    covariates: Sequence[str],
    pretrained: str | None,
    seed: int,
    code: str,
    device: str,
    outputs: Mapping[str, str],
) -> None:
    """Adapt the network at `pretrained`, or a new one, to the cases; the rest as of pretrain.

    covariates may be empty for a method that does not read them.
    """
    train_fold(
        learner=resolve(learner)(settings, "finetune", device),
        phase="finetune",
        cases=case_files(cases, lifts, model=models, plan=plans, postop=postops, covariates=covariates),
        pretrained=pretrained,
        seed=seed,
        code=code,
        out=outputs["network"],
        history=outputs["history"],
    )


def finetune_once(read: Mapping[str, object], settings: Mapping[str, object], outputs: Mapping[str, str]) -> None:
    """Nothing is trained anew where other jobs have made files again of the same content."""
    with Stages(Path(outputs["network"]).with_name(".finetune.json")) as stages:
        stages(finetune, read, {"outputs": outputs}, settings)


if __name__ == "__main__":
    attach_log(snakemake.log[0])
    params, files, about = snakemake.params, snakemake.input, snakemake.wildcards
    device = choose_device(snakemake.resources.gpu, snakemake.threads)
    seed = derive_seed(params.seed, "finetune", f"{about.fold}/{about.method}")
    settings = {name: params[name] for name in ("learner", "settings", "cases", "code")}
    read = gathered_files(files, params.cases, "models", "lifts", "plans", "postops", "covariates")
    read["pretrained"] = files.get("network") or None
    finetune_once(
        read=read, settings=settings | {"seed": seed, "device": device}, outputs=dict(snakemake.output.items())
    )
