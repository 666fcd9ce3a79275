"""Fails where the stability sweep has a wrong cell that the certificate of a prediction would not mark."""

from pathlib import Path

from pinnochio.columns import read_table
from pinnochio.logs import attach_log
from studies.stability.table import OUTCOMES, STABILITY, unmarked


def check_stability(table: str, verdict: str) -> None:
    """Write the counts of a sweep's table; RuntimeError that names every wrong cell that nothing warns of."""
    cells = read_table(table, STABILITY)
    if wrong := unmarked(cells):
        raise RuntimeError(f"{len(wrong)} of {len(cells)} cells are wrong, see {table}:\n" + "\n".join(wrong))
    counts = cells["outcome"].value_counts()
    said = ", ".join(f"{counts.get(outcome, 0)} {outcome}" for outcome in OUTCOMES)
    Path(verdict).write_text(f"{len(cells)} cells: {said}, every wrong one marked.\n", encoding="utf-8")


if __name__ == "__main__":
    attach_log(snakemake.log[0])
    check_stability(table=snakemake.input.table, verdict=snakemake.output.verdict)
