"""Makes the picture of the dial's table."""

from pinnochio.figures.corrections import dial_picture
from pinnochio.logs import attach_log
from pinnochio.tables.corrections import DIAL
from pinnochio.tables.engine import read_table


def render_dial(table: str, picture: str) -> None:
    """Draw dial.csv: residual and accuracy over the seconds that they take."""
    dial_picture(read_table(table, DIAL), picture)


if __name__ == "__main__":
    attach_log(snakemake.log[0])
    render_dial(table=snakemake.input.table, picture=snakemake.output.picture)
