"""Makes the picture of the trade-off."""

from collections.abc import Sequence

from pinnochio.figures.tradeoff import tradeoff_picture
from pinnochio.logs import attach_log
from pinnochio.tables.engine import read_table
from pinnochio.tables.tradeoff import TRADEOFF


def render_tradeoff(table: str, pictures: Sequence[str]) -> None:
    """Draw tradeoff.csv to every path."""
    tradeoff_picture(read_table(table, TRADEOFF), pictures)


if __name__ == "__main__":
    attach_log(snakemake.log[0])
    render_tradeoff(table=snakemake.input.table, pictures=list(snakemake.output))
