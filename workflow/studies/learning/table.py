"""The learning curve: what the same held-out patients gain when a method learns from more of the others."""

import os
from collections.abc import Mapping, Sequence

import pandas as pd

from pinnochio.columns import Column, check, number, read_tables
from pinnochio.methods.names import BASELINE, FLOOR
from pinnochio.metrics.case_columns import BY_NAME, CASES
from pinnochio.seeds import derive_seed
from pinnochio.statistics.shares import explained
from pinnochio.statistics.wilcoxon import bootstrap_interval, compare
from pinnochio.tables.comparison import count
from pinnochio.tables.document import Block, Table, View, views, with_interval

ERRORS = {"cd": "Chamfer distance", "skin_error_mean": "error of the true skin"}
ENDS = ("low", "high")


def _of_error(name: str) -> list[Column]:
    words = {f"{name}_mean": f"mean of {name}"}
    words |= {f"{name}_{end}": f"end of the bootstrap 95% interval of {name}_mean" for end in ENDS}
    words |= {f"{name}_difference": f"mean of {name} minus that of {BASELINE}"}
    words |= {f"{name}_difference_{end}": f"end of the bootstrap 95% interval of {name}_difference" for end in ENDS}
    return [number(key, BY_NAME[name].unit, said, BY_NAME[name].summary) for key, said in words.items()]


LEARNING = (
    Column("method", str, "", "method"),
    Column("patients", int, "", "training patients"),
    Column("n", int, "", "held-out patients with a metric, the same in all rows"),
    *(column for name in ERRORS for column in _of_error(name)),
    number("explained", "", f"(cd of {BASELINE} - cd) / (cd of {BASELINE} - cd of {FLOOR}), of means", ".3f"),
    number("explained_low", "", "end of the bootstrap 95% interval of explained", ".3f"),
    number("explained_high", "", "end of the bootstrap 95% interval of explained", ".3f"),
)


def summarise(rows: Mapping[tuple[str, int], pd.DataFrame], seed: int = 0) -> pd.DataFrame:
    """One row of LEARNING per method and number of training patients, in that order, of the CASES rows of the held-out
    patients. (BASELINE, 0) must be among them; without (FLOOR, 0) nothing is explained."""
    by_case = {key: check(cases, CASES).set_index("case") for key, cases in rows.items()}
    baseline, floor = by_case[BASELINE, 0], by_case.get((FLOOR, 0))
    summaries = []
    for (method, patients), group in by_case.items():
        row = {"method": method, "patients": patients, "n": int(group["cd"].notna().sum())}
        for name in ERRORS:
            key = f"{method}/{patients}/{name}"
            values = group[name].dropna()
            low, high = bootstrap_interval(values, derive_seed(seed, "learning", key))
            row |= {f"{name}_mean": values.mean(), f"{name}_low": low, f"{name}_high": high}
            both = pd.concat([group[name], baseline[name]], axis=1, keys=("own", "baseline")).dropna()
            if len(both) and method not in (BASELINE, FLOOR):
                test = compare(both["own"], both["baseline"], derive_seed(seed, "difference", key))
                ends = {"": test.mean, "_low": test.low, "_high": test.high}
                row |= {f"{name}_difference{end}": value for end, value in ends.items()}
        if floor is not None:
            common = pd.concat([group["cd"], baseline["cd"], floor["cd"]], axis=1).dropna().to_numpy().T
            share = explained(*common, derive_seed(seed, "explained", f"{method}/{patients}"))
            row |= {"explained": share.share, "explained_low": share.low, "explained_high": share.high}
        summaries.append(row)
    return check(pd.DataFrame(summaries).reindex(columns=[column.name for column in LEARNING]), LEARNING)


def tabulate(
    untrained: Sequence[str | os.PathLike],
    trained: Sequence[str | os.PathLike],
    untaught: Sequence[str],
    methods: Sequence[str],
    patients: Sequence[int],
    cohort: str,
    seed: int,
) -> Table:
    """The metrics of the folds: of each name in untaught, then, of each method, number by number of patients."""
    keys = [(name, 0) for name in untaught] + [(method, size) for method in methods for size in patients]
    files = [*untrained, *trained]
    folds = len(files) // len(keys)
    rows = {key: read_tables(files[i * folds : (i + 1) * folds], CASES) for i, key in enumerate(keys)}
    return table(summarise(rows, seed), cohort)


def table(frame: pd.DataFrame, cohort: str) -> Table:
    """The table of rows of LEARNING."""
    view = views(LEARNING, {"method": "Method", "patients": "Training patients"})
    for name, words in ERRORS.items():
        if frame[f"{name}_mean"].notna().any():
            text = with_interval(LEARNING, f"{name}_mean", f"{name}_low", f"{name}_high")
            view.append(View(f"{words} [{BY_NAME[name].unit}]".capitalize(), text))
    if frame["explained"].notna().any():
        view.append(View("Explained", with_interval(LEARNING, "explained", "explained_low", "explained_high")))
    caption = (
        f"Learning curve, {cohort}, {count(frame['n'])} held-out patients, the same in every row: mean and bootstrap "
        f"95% interval over patients. Fewer training patients are among more. Explained: share of what {BASELINE} "
        f"misses above {FLOOR}."
    )
    return Table(frame, LEARNING, [Block.of(frame, view, caption)], enough(frame))


def enough(frame: pd.DataFrame) -> list[str]:
    """How many patients each method wants before it is better than BASELINE, in words."""
    said = []
    for method, group in frame[frame["patients"] > 0].groupby("method", sort=False):
        for name, words in ERRORS.items():
            if group[f"{name}_difference"].isna().all():
                continue
            better = group[f"{name}_difference_high"] < 0
            lasting = group["patients"][better[::-1].cummin()[::-1].astype(bool)]
            until = f"with up to {group['patients'].max()} training patients it is not told apart or worse"
            verdict = f"better from {lasting.min()} training patients on, as far as measured" if len(lasting) else until
            said.append(f"{method} against {BASELINE} by {words}: {verdict}.")
    return said
