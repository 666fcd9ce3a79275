"""What a study found, in three sentences: what was compared, what is best by how much, what is not told apart."""

from pinnochio.methods.names import in_sentence, written
from pinnochio.statistics.ranking import Ranking

AGAINST = ("fem_sliding", "no_change")  # what the best is said to be better than, beside the second best


def sentences(ranking: Ranking, cohort: str, folds: int, motion: str) -> list[str]:
    """The three sentences. cohort: what it is called; motion: achieved or planned."""
    names, means = list(ranking.means.index), ranking.means
    moved = "the bone motion that was achieved" if motion == "achieved" else "the plan"
    compared = (
        f"{len(names)} methods predicted the faces of {ranking.patients} patients of the {cohort} from {moved}; what "
        f"learns had not seen the patient ({folds} folds)."
    )
    if not ranking.tested:
        between = (
            f"Their mean distance from the outcome lies between {means.iloc[0]:.2f} mm ({in_sentence(names[0])}) and "
            f"{means.iloc[-1]:.2f} mm ({in_sentence(names[-1])})."
        )
        return [compared, between, f"{ranking.patients} patients are too few to tell methods apart."]
    nearest = f"{written(ranking.best)} comes nearest to the outcome: {means.iloc[0]:.2f} mm off in the mean"
    gains = []
    for name in dict.fromkeys([*names[1:2], *(other for other in AGAINST if other in ranking.against)]):
        test, _ = ranking.against[name]
        gains.append(f"{_mm(test.mean)} mm [{_mm(test.low)}, {_mm(test.high)}] less than {in_sentence(name)}")
    best = f"{nearest}, {', '.join(gains)}."
    if ranking.alike:
        alike = f"Not told apart from it: {', '.join(map(in_sentence, ranking.alike))}."
    else:
        alike = "Every other method is told apart from it."
    return [compared, best, alike]


def _mm(value: float) -> str:
    """Two decimals, and no minus before nothing."""
    return f"{round(value, 2) + 0.0:.2f}"
