"""Makes a fold's pretrained network of the training patients' finite-element samples."""

from collections.abc import Mapping, Sequence

from pinnochio.logs import attach_log
from pinnochio.references import resolve
from pinnochio.seeds import derive_seed
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


if __name__ == "__main__":
    attach_log(snakemake.log[0])
    pretrain(
        learner=snakemake.params.learner,
        settings=snakemake.params.settings,
        cases=snakemake.params.cases,
        models=snakemake.input.models,
        lifts=snakemake.input.lifts,
        fem_samples=snakemake.input.fem_samples,
        seed=derive_seed(snakemake.params.seed, "pretrain", f"{snakemake.wildcards.fold}/{snakemake.wildcards.method}"),
        code=snakemake.params.code,
        device=choose_device(snakemake.resources.gpu, snakemake.threads),
        outputs=dict(snakemake.output.items()),
    )
