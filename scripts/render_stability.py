"""Makes the picture of the stability sweep of its table."""

from pinnochio.experiments.stability import STABILITY
from pinnochio.figures.stability import stability_picture
from pinnochio.logs import attach_log
from pinnochio.tables.engine import read_table


def render_stability(table: str, picture: str) -> None:
    """Draw stability.csv as a matrix of settings and methods."""
    stability_picture(read_table(table, STABILITY), picture)


if __name__ == "__main__":
    attach_log(snakemake.log[0])
    render_stability(table=snakemake.input.table, picture=snakemake.output.picture)
