"""Every input of the corpus goes in with the right result, or is refused by case, file and remedy: nothing else."""

import pytest

from tests.helpers.corpus import KINDS, inputs
from tests.helpers.judging import REFUSED, outcomes

GOOD = ("accepted", REFUSED)


def check(kind: str, seed: int, count: int, folder) -> dict[str, str]:
    results = outcomes(inputs(kind, seed, count), folder)
    wrong = {name: what for name, what in results.items() if what not in GOOD}
    assert not wrong, f"{len(wrong)} of {len(results)}: {wrong}"
    assert set(results.values()) == set(GOOD)  # a corpus that is all refused, or all accepted, tries nothing
    return results


@pytest.mark.parametrize("kind", KINDS)
def test_a_part_of_the_corpus(kind, tmp_path):
    assert len(check(kind, 0, 2, tmp_path)) > 20


@pytest.mark.full
@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("kind", KINDS)
def test_the_whole_corpus(kind, seed, tmp_path):
    check(kind, 1 + seed, 25, tmp_path)
