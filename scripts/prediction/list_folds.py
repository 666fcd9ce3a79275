"""Makes the list of folds, so that methods made elsewhere train on the same patients."""

import csv
from collections.abc import Collection, Mapping, Sequence

from pinnochio.files import replacing
from pinnochio.logs import attach_log


def list_folds(held_out: Mapping[str, Sequence[str]], scanned: Collection[str], table: str) -> None:
    """Write case, the fold that holds it out, and whether it has a post-operative scan (True, False), as CSV."""
    rows = sorted((case, fold, case in scanned) for fold, cases in held_out.items() for case in cases)
    with replacing(table) as temporary, open(temporary, "w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(("case", "fold", "scanned"))
        writer.writerows(rows)


if __name__ == "__main__":
    attach_log(snakemake.log[0])
    list_folds(held_out=snakemake.params.held_out, scanned=snakemake.params.scanned, table=snakemake.output.table)
