"""Makes the list of what the planner needs of a prepared patient and its models."""

from collections.abc import Mapping, Sequence
from pathlib import Path

from pinnochio.logs import attach_log
from studies.planner.prepared import Prepared


def prepare_planner(
    case: str, files: Mapping[str, str | None], plans: Sequence[str], settings: Mapping, out: str
) -> None:
    """Write the list with absolute paths, so that the planner can be started from any folder.

    files: model, skin, bone, lift (or none), quality; plans: checked plan files, `{name}/plan.json`;
    settings: home, archive, method, corrections, fem, invert and scan of a Prepared.
    """
    files = {**files, **{name: settings[name] for name in ("home", "archive")}}
    absolute = {name: path and str(Path(path).resolve()) for name, path in files.items()}
    by_name = {Path(plan).parent.name: str(Path(plan).resolve()) for plan in plans}
    Prepared(case=case, plans=by_name, **{**settings, **absolute}).write(out)


if __name__ == "__main__":
    attach_log(snakemake.log[0])
    files = {name: snakemake.input[name] for name in ("model", "skin", "bone", "quality")}
    prepare_planner(
        case=snakemake.wildcards.case,
        files=files | {"lift": next(iter(snakemake.input.get("lifts", [])), None)},
        plans=snakemake.input.get("plans", []),
        settings=snakemake.params.settings,
        out=snakemake.output.prepared,
    )
