"""Methods in order of their error, what is told apart, and the sentences that say so."""

import pandas as pd
import pytest

from pinnochio.methods.names import WRITTEN, few, in_sentence, written
from pinnochio.report.answer import sentences
from pinnochio.statistics.attainable import attainable
from pinnochio.statistics.ranking import rank
from tests.helpers.settings import CONFIG


def cases(patients: int, **errors) -> pd.DataFrame:
    """Errors of methods, mm: the value of each method and something that differs by patient."""
    return pd.DataFrame(
        [(f"P{n}", name, of(n)) for name, of in errors.items() for n in range(patients)],
        columns=["case", "method", "cd"],
    )


BEST = {"pinnochio_plus": lambda n: 0.6 + 0.01 * n}
WORSE = {"fem_sliding": lambda n: 0.7 + 0.011 * n, "no_change": lambda n: 1.5 + 0.02 * n}
ALIKE = {"elastic": lambda n: 0.605 + 0.01 * n + 0.03 * (-1) ** n * (n + 1) / 20}


def test_two_sided_p_is_attainable_or_not():
    assert attainable(6, 1) and not attainable(6, 2) and not attainable(5, 1)  # 2/64, twice that, 2/32
    assert attainable(40, 16) and not attainable(8, 16)


def test_methods_that_do_not_differ_are_named():
    ranking = rank(cases(20, **WORSE, **BEST, **ALIKE), [*WORSE, *BEST, *ALIKE], 1)
    assert list(ranking.means.index) == ["pinnochio_plus", "elastic", "fem_sliding", "no_change"]
    assert ranking.alike == ["elastic"] and ranking.tested
    compared, best, alike = sentences(ranking, "clinic", 5, "achieved")
    assert compared.startswith("4 methods predicted the faces of 20 patients of the clinic") and "(5 folds)" in compared
    assert best.startswith("PINNOCHIO plus comes nearest to the outcome: 0.70 mm off in the mean, 0.0")
    assert "less than sliding FEM" in best and "less than no change" in best
    assert alike == "Not told apart from it: linear elasticity."


def test_of_few_patients_no_method_is_said_to_be_best():
    ranking = rank(cases(6, **WORSE, **BEST), [*WORSE, *BEST], 1)
    said = " ".join(sentences(ranking, "clinic", 2, "planned"))
    assert not ranking.tested and "nearest" not in said and "from the plan" in said
    assert "between 0.62 mm (PINNOCHIO plus) and 1.55 mm (no change)" in said and "too few" in said


def test_a_patient_whom_a_method_lacks_counts_for_none():
    frame = cases(20, **WORSE, **BEST).iloc[1:]
    assert rank(frame, [*WORSE, *BEST], 1).patients == 19


def test_every_method_has_a_name_that_people_write():
    assert set(CONFIG["methods"]) <= set(WRITTEN) and len(set(WRITTEN.values())) == len(WRITTEN)
    assert written("mine") == in_sentence("mine") == "mine" and in_sentence("acmt") == "ACMT-Net"


@pytest.mark.parametrize("count", [1, 5, 30])
def test_few_methods_keep_their_order(count):
    names = CONFIG["methods"]
    chosen = few(names, count)
    assert len(chosen) == min(count, len(names)) and chosen == [name for name in names if name in chosen]
    assert "fem_sliding" in chosen  # what all others are held against
