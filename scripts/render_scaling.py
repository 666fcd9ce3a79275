"""Makes the picture of the table of scaling."""

from collections.abc import Sequence

from pinnochio.figures.scaling import scaling_picture
from pinnochio.logs import attach_log
from pinnochio.tables.engine import read_table
from pinnochio.tables.scaling import SCALING


def render_scaling(table: str, pictures: Sequence[str]) -> None:
    """Draw scaling.csv: seconds and memory of each stage over the nodes, with the exponents; one file per format."""
    scaling_picture(read_table(table, SCALING), pictures)


if __name__ == "__main__":
    attach_log(snakemake.log[0])
    render_scaling(table=snakemake.input.table, pictures=list(snakemake.output))
