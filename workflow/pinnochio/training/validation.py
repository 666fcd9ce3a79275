"""Which training patients are held back to choose the weights."""

from collections.abc import Sequence

from pinnochio.seeds import generator

LARGEST_SHARE = 4  # at most one patient in so many is held back


def held_back(cases: Sequence[str], count: int) -> list[bool]:
    """True for `count` of the fold's training cases, for fewer where that is more than a quarter of them.

    Drawn from the cases alone, so that both phases and all methods of a fold hold back the same patients.
    """
    order = generator(0, "validation", ",".join(cases)).permutation(len(cases))
    chosen = order[: min(count, len(cases) // LARGEST_SHARE)]
    return [index in chosen for index in range(len(cases))]
