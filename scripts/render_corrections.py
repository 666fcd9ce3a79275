"""Makes the picture of the dial's table."""

from pinnochio.figures.corrections import corrections_picture
from pinnochio.logs import attach_log
from pinnochio.tables.corrections import CORRECTIONS
from pinnochio.tables.engine import read_table


def render_corrections(table: str, picture: str) -> None:
    """Draw corrections.csv: residual and accuracy over the seconds that they take."""
    corrections_picture(read_table(table, CORRECTIONS), picture)


if __name__ == "__main__":
    attach_log(snakemake.log[0])
    render_corrections(table=snakemake.input.table, picture=snakemake.output.picture)
