"""Makes a fold's final network: the pretrained one, or a new one, adapted to the training patients' outcomes."""

from collections.abc import Mapping, Sequence

from pinnochio.logs import attach_log
from pinnochio.references import resolve
from pinnochio.seeds import derive_seed
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


if __name__ == "__main__":
    attach_log(snakemake.log[0])
    finetune(
        learner=snakemake.params.learner,
        settings=snakemake.params.settings,
        cases=snakemake.params.cases,
        models=snakemake.input.models,
        lifts=snakemake.input.lifts,
        plans=snakemake.input.plans,
        postops=snakemake.input.postops,
        covariates=snakemake.input.get("covariates", []),
        pretrained=snakemake.input.get("network") or None,
        seed=derive_seed(snakemake.params.seed, "finetune", f"{snakemake.wildcards.fold}/{snakemake.wildcards.method}"),
        code=snakemake.params.code,
        device=choose_device(snakemake.resources.gpu, snakemake.threads),
        outputs=dict(snakemake.output.items()),
    )
