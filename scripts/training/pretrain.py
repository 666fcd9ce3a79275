"""Makes a fold's pretrained network of the training patients' finite-element samples."""

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


def pretrain(
    learner: str,
    settings: Mapping,
    cases: Sequence[str],
    models: Sequence[str],
    lifts: Sequence[str],
    fem_samples: Sequence[str],
    seed: int,
    code: str,
    device: str,
    outputs: Mapping[str, str],
) -> None:
    """Train by the class `learner` on the cases and nothing else; outputs names the files network and history.

    settings: values of the sections that it reads; lifts may be empty for a network without one; code: hash of
    what trains.
    """
    train_fold(
        resolve(learner)(settings, "pretrain", device),
        "pretrain",
        case_files(cases, lifts, model=models, fem_samples=fem_samples),
        seed=seed,
        code=code,
        out=outputs["network"],
        history=outputs["history"],
    )


def pretrain_once(read: Mapping[str, object], settings: Mapping[str, object], outputs: Mapping[str, str]) -> None:
    """Nothing is trained anew where other jobs have made files again of the same content."""
    with Stages(Path(outputs["network"]).with_name(".pretrain.json")) as stages:
        stages(pretrain, read, {"outputs": outputs}, settings)


if __name__ == "__main__":
    attach_log(snakemake.log[0])
    params, files, about = snakemake.params, snakemake.input, snakemake.wildcards
    device = choose_device(snakemake.resources.gpu, snakemake.threads)
    seed = derive_seed(params.seed, "pretrain", f"{about.fold}/{about.method}")
    settings = {name: params[name] for name in ("learner", "settings", "cases", "code")}
    read = gathered_files(files, params.cases, "models", "lifts", "fem_samples")
    pretrain_once(
        read=read, settings=settings | {"seed": seed, "device": device}, outputs=dict(snakemake.output.items())
    )
