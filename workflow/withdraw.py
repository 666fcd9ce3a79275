"""Takes a patient out of a study: deletes all that was made of the patient, alone or with others, and the table's row.

python workflow/withdraw.py CASE [--table cases.tsv] [--results results]

The files that the table named are the user's, and stay. The next run makes trainings and tables without the patient; of
the others nothing is made again before these. A virtual patient has no row: virtual.without names it.
"""

import argparse
import csv
import os
import re
import shutil
from base64 import urlsafe_b64encode
from pathlib import Path

from pinnochio.files import replacing
from pinnochio.importing.cohort import separator

# What is made of several patients together, below the results.
SHARED = (
    "folds",
    "planned",
    "held_out",
    "methods",
    "archive",
    "tables",
    "figures",
    "inverse",
    "tradeoff",
    "cohort.csv",
)
SHARED += ("folds.csv", "provenance.json", "report.html", "virtual/README.md", "virtual/SHA256SUMS*", "virtual/*.*")


def withdraw(case: str, results: Path, table: Path | None, snakemake: Path = Path(".snakemake")) -> int:
    """Number of files that are deleted; those of patients whose names only begin alike stay."""
    named = re.compile(rf"{re.escape(case)}([._].*)?")
    doomed = {path for pattern in SHARED for path in results.glob(pattern)}
    doomed |= {results / home / case for home in ("cases", "virtual")}
    for home in ("logs", "benchmarks"):
        doomed |= {path for path in (results / home).rglob("*") if named.fullmatch(path.name)}
    # What jobs of several patients said.
    word = re.compile(rf"(?<![\w-]){re.escape(case)}(?![\w-])")
    for log in [*(results / "logs").rglob("*.log"), *(snakemake / "log").glob("*.log")]:
        doomed |= {log} if word.search(log.read_text(encoding="utf-8", errors="replace")) else set()
    files = [file for path in doomed for file in (path, *path.rglob("*")) if file.exists()]
    for file in files:
        (snakemake / "metadata" / urlsafe_b64encode(os.fsencode(file)).decode()).unlink(missing_ok=True)
    for path in doomed:
        shutil.rmtree(path) if path.is_dir() else path.unlink(missing_ok=True)
    if table:
        text = table.read_text(encoding="utf-8-sig")
        rows, sign = text.splitlines(keepends=True), separator(text)
        cells = [[cell.strip() for cell in next(csv.reader([row], delimiter=sign), [])] for row in rows]
        column = next(row.index("case") for row in cells if "case" in row)
        with replacing(table) as temporary:
            kept = (row for row, parts in zip(rows, cells, strict=True) if parts[column : column + 1] != [case])
            temporary.write_text("".join(kept), encoding="utf-8")
    return len(files)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("case")
    parser.add_argument("--table", type=Path)
    parser.add_argument("--results", type=Path, default=Path("results"))
    chosen = parser.parse_args()
    print(f"Deleted: {withdraw(chosen.case, chosen.results, chosen.table)}. Now run the study again.")
