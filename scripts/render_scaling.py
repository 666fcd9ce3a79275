"""Makes the picture of the table of scaling."""

from collections.abc import Sequence

from pinnochio.evaluation.scaling import SCALING
from pinnochio.evaluation.scaling_picture import scaling_picture
from pinnochio.evaluation.tables import read_table
from pinnochio.logs import attach_log


def render_scaling(table: str, pictures: Sequence[str]) -> None:
    """Draw scaling.csv: seconds and memory of each stage over the nodes, with the exponents; one file per format."""
    scaling_picture(read_table(table, SCALING), pictures)


if __name__ == "__main__":
    attach_log(snakemake.log[0])
    render_scaling(snakemake.input.table, list(snakemake.output))
