"""Makes the picture of the dial's table."""

from pinnochio.evaluation.dial import DIAL
from pinnochio.evaluation.dial_picture import dial_picture
from pinnochio.evaluation.tables import read_table
from pinnochio.logs import attach_log


def render_dial(table: str, picture: str) -> None:
    """Draw dial.csv: residual and accuracy over the seconds that they take."""
    dial_picture(read_table(table, DIAL), picture)


if __name__ == "__main__":
    attach_log(snakemake.log[0])
    render_dial(snakemake.input.table, snakemake.output.picture)
