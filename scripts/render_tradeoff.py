"""Makes the picture of the trade-off."""

from collections.abc import Sequence

from pinnochio.evaluation.tables import read_table
from pinnochio.logs import attach_log
from pinnochio.tradeoff.picture import tradeoff_picture
from pinnochio.tradeoff.table import TRADEOFF


def render_tradeoff(table: str, pictures: Sequence[str]) -> None:
    """Draw tradeoff.csv to every path."""
    tradeoff_picture(read_table(table, TRADEOFF), pictures)


if __name__ == "__main__":
    attach_log(snakemake.log[0])
    render_tradeoff(snakemake.input.table, list(snakemake.output))
