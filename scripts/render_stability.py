"""Makes the picture of the stability sweep of its table."""

from pinnochio.evaluation.stability import STABILITY
from pinnochio.evaluation.stability_picture import stability_picture
from pinnochio.evaluation.tables import read_table
from pinnochio.logs import attach_log


def render_stability(table: str, picture: str) -> None:
    """Draw stability.csv as a matrix of settings and methods."""
    stability_picture(read_table(table, STABILITY), picture)


if __name__ == "__main__":
    attach_log(snakemake.log[0])
    render_stability(snakemake.input.table, snakemake.output.picture)
