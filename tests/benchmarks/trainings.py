"""How far trainings of the same methods on the same patients differ, and the tables of their mean.

python tests/benchmarks/trainings.py OUTPUT STUDY TRAINING [TRAINING ...]

Each a `cases.csv`: of the whole study, then of each training's methods, which take the study's place.
OUTPUT/trainings.csv: by method and measure the mean over patients and trainings, the standard deviation over trainings
of that mean and of a patient's value. OUTPUT/cases.csv: each patient's mean over the trainings (of counts the largest);
better.* and claims.* are made of it.
"""

import sys
from pathlib import Path

import pandas as pd
import yaml

sys.path.extend(str(Path(__file__).parents[2] / folder) for folder in ("", "workflow"))

from pinnochio.code import ROOT
from pinnochio.columns import Column, number, read_table, write_csv
from pinnochio.metrics.case_columns import CASES
from pinnochio.tables.comparison import BOUNDS
from scripts.tables.tabulate import tabulate

MEASURES = ("cd", "hd95", "pwr1", "pwr2", "skin_error_mean", "volume_error_mean", "raw_min_jacobian", "eqres_rel")
TRAININGS = (
    Column("method", str, "", "method"),
    Column("measure", str, "", "column of cases; turned: patients with raw_inverted above 0"),
    Column("trainings", int, "", "number"),
    number("mean", "", "over patients and trainings", ".4f"),
    number("sd_of_mean", "", "over trainings, of the mean over patients", ".4f"),
    number("sd_of_patient", "", "over trainings, of a patient's value: root of the mean variance", ".4f"),
    number("lowest", "", "of the trainings' means", ".4f"),
    number("highest", "", "of the trainings' means", ".4f"),
)


def spread(trained: pd.DataFrame) -> pd.DataFrame:
    """Rows of TRAININGS of rows of CASES with a `training` each, of methods that have several."""
    rows, several = [], trained.groupby("method")["training"].transform("nunique") > 1
    for method, group in trained[several].groupby("method", sort=False):
        for measure in MEASURES:
            values = group.pivot(index="training", columns="case", values=measure)
            means, patients = values.mean(axis=1), values.var().mean() ** 0.5
            rows.append((method, measure, len(means), means.mean(), means.std(), patients, means.min(), means.max()))
        turned = (group["raw_inverted"] > 0).groupby(group["training"]).sum()
        rows.append((method, "turned", len(turned), turned.mean(), turned.std(), None, turned.min(), turned.max()))
    return pd.DataFrame(rows, columns=[column.name for column in TRAININGS]).dropna(subset="mean")


def of_trainings(study: pd.DataFrame, trained: pd.DataFrame) -> pd.DataFrame:
    """Rows of CASES: the study's, and for trained methods each patient's mean."""
    how = {column.name: "mean" if column.kind is float else "max" for column in CASES}
    how |= {column.name: "first" for column in CASES if column.kind is str} | {"converged": "min"}
    means = trained.groupby(["method", "case"], sort=False).agg(how).reset_index(drop=True)
    kept = study[~study["method"].isin(trained["method"])]
    return pd.concat([kept, means])[[column.name for column in CASES]]


def main(output: str, study: str, *trainings: str) -> None:
    folder, whole = Path(output), read_table(study, CASES)
    trained = pd.concat([read_table(path, CASES).assign(training=n) for n, path in enumerate(trainings)])
    folder.mkdir(parents=True, exist_ok=True)
    write_csv(spread(trained), folder / "trainings.csv", TRAININGS)
    write_csv(of_trainings(whole, trained), folder / "cases.csv", CASES)
    config = yaml.safe_load(Path(ROOT, "config/config.yaml").read_bytes())
    methods = [name for name in whole["method"].unique() if name not in BOUNDS]
    named = {"cases": folder / "cases.csv", "cohort": "virtual cohort (locked)", "seed": int(whole["seed"].iloc[0])}
    compared = {"reference": config["better"], "methods": methods, "bounds": [*BOUNDS], "published": False}
    tabulate("pinnochio.tables.accuracy", named | compared, str(folder / "better.csv"))
    tabulate("pinnochio.tables.claims", named, str(folder / "claims.csv"))


if __name__ == "__main__":
    main(*sys.argv[1:]) if len(sys.argv) > 3 else sys.exit(__doc__)
