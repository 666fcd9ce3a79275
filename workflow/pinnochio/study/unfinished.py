"""Looking at a study does not begin one: a report of a study that is not finished is refused before it starts."""

from collections.abc import Mapping, Sequence

from pinnochio.errors import InputError
from pinnochio.study.console import in_words

LONGEST = 120.0  # s, of what a report or a picture may make first


def refuse_unfinished(
    targets: Sequence[str], counts: Mapping[str, int], expected: Mapping[str, float], cores: int, results: str
) -> None:
    """InputError where all targets show what a study found and the study itself would be made for them.

    counts: jobs by rule that are to be run, with their `total`; expected: seconds of one job by rule.
    """
    shows = [name for name in targets if name in ("report", "figures") or name.startswith(f"{results}/figures/")]
    if not shows or len(shows) < len(targets):
        return
    seconds = sum(expected[rule] * count for rule, count in counts.items() if rule != "total") / cores
    if seconds > LONGEST:
        raise InputError(
            "-",
            results,
            f"the study behind {shows[0]} is not finished: {counts['total']} jobs are left, about {in_words(seconds)} "
            f"on {cores} cores by the times of an earlier study. Nothing was started",
            f"if that is wanted, name both in the same command: snakemake --cores {cores} all {' '.join(shows)}; "
            "make quick is the small study",
        )
