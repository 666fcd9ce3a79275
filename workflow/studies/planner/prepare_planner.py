"""Makes the list of what the planner needs of a prepared patient and its models."""

from collections.abc import Sequence
from pathlib import Path

from pinnochio.logs import attach_log
from studies.planner.prepared import Prepared


def prepare_planner(
    case: str,
    model: str,
    skin: str,
    bone: str,
    lift: str | None,
    covariates: str,
    quality: str,
    plans: Sequence[str],
    settings: dict,
    out: str,
) -> None:
    """Write the list with absolute paths, so that the planner can be started from any folder.

    plans: checked plan files, `{name}/plan.json`; settings: home, archive, method, corrections, fem, invert
    and scan of a Prepared.
    """

    def absolute(path: str) -> str:
        return str(Path(path).resolve())

    prepared = Prepared(
        case=case,
        model=absolute(model),
        lift=lift and absolute(lift),
        covariates=absolute(covariates),
        quality=absolute(quality),
        plans={Path(plan).parent.name: absolute(plan) for plan in plans},
        home=absolute(settings["home"]),
        archive=absolute(settings["archive"]),
        method=settings["method"],
        corrections=settings["corrections"],
        fem=settings["fem"],
        invert=settings["invert"],
        skin=absolute(skin),
        bone=absolute(bone),
        scan=settings["scan"],
    )
    prepared.write(out)


if __name__ == "__main__":
    attach_log(snakemake.log[0])
    prepare_planner(
        case=snakemake.wildcards.case,
        model=snakemake.input.model,
        skin=snakemake.input.skin,
        bone=snakemake.input.bone,
        lift=next(iter(snakemake.input.get("lifts", [])), None),
        covariates=snakemake.input.covariates,
        quality=snakemake.input.quality,
        plans=snakemake.input.get("plans", []),
        settings=snakemake.params.settings,
        out=snakemake.output.prepared,
    )
