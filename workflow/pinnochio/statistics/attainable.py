"""Whether so many patients can show a difference at all; apart from the tests, whose library takes long to load."""

# Below six pairs the smallest two-sided p is 2/2^5 = 0.0625: no outcome could be significant.
SMALLEST_N = 6


def attainable(n: int, comparisons: int, level: float = 0.05) -> bool:
    """Whether so many comparisons of n patients can give a Holm-corrected p below the level at all.

    The smallest two-sided p of the signed-rank test is 2 / 2^n, where every difference has the same sign.
    """
    return n >= SMALLEST_N and comparisons * 2.0 ** (1 - n) < level
