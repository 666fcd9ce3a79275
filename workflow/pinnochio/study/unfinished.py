"""Looking at a study does not begin one: a report of a study that is not finished is refused before it starts."""

from collections.abc import Mapping, Sequence

from pinnochio.errors import InputError

JUDGES = {"predict_cases", "predict_both_motions", "evaluate"}  # rules without whose jobs there is nothing to show


def refuse_unfinished(targets: Sequence[str], counts: Mapping[str, int], cores: int, results: str) -> None:
    """InputError where all targets show what a study found and its patients would have to be judged for them.

    counts: jobs by rule that are to be run, with their `total`.
    """
    shows = [name for name in targets if name in ("report", "figures") or name.startswith(f"{results}/figures/")]
    if shows and len(shows) == len(targets) and JUDGES & counts.keys():
        raise InputError(
            "-",
            results,
            f"the study behind {shows[0]} is not finished: {counts['total']} jobs are left. Nothing was started",
            f"if that is wanted, name both in the same command: snakemake --cores {cores} all {' '.join(shows)}; "
            "make quick is the small study",
        )
