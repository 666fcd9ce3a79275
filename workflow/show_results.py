"""Prints what a finished study found, in a few lines: `python workflow/show_results.py results/quick`."""

import argparse
import sys
from pathlib import Path

from pinnochio.columns import read_csv
from pinnochio.errors import InputError
from pinnochio.methods.names import few, written
from pinnochio.statistics.attainable import attainable

ROWS = 5
COLUMNS = {"cd_mean": "mm off", "pwr2_mean": "within 2 mm", "seconds_mean": "seconds per plan"}


def lines(results: Path) -> list[str]:
    """Five methods of the study's table of accuracy, what they are of, and where the report lies."""
    names = ["method", "bound", "n", *COLUMNS]
    table = read_csv(results / "tables/accuracy.csv", usecols=names, dtype={"bound": bool}).set_index("method")
    methods = table[~table["bound"]]
    shown = methods.loc[few(methods.index, ROWS)]
    width = max(map(len, map(written, shown.index)))
    head = f"{'':{width}}" + "".join(f"{title:>19}" for title in COLUMNS.values())
    said = [head]
    for method, row in shown.iterrows():
        values = f"{row['cd_mean']:.2f}", f"{row['pwr2_mean']:.1f} %", f"{row['seconds_mean']:.3f}"
        said.append(f"{written(method):{width}}" + "".join(f"{value:>19}" for value in values))
    patients = int(methods["n"].max())
    if not attainable(patients, len(methods) - 1):
        said.append(f"A demonstration: {patients} patients are too few to tell methods apart.")
    page = results / "report.html"
    return [*said, f"Report: {page}" if page.is_file() else f"Tables: {results / 'tables'}"]


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("results", type=Path, help="folder of the results")
    try:
        print("\n".join(lines(parser.parse_args().results)))
    except InputError as error:
        sys.exit(str(error))
