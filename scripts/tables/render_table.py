"""Makes the picture of a table by the module of pinnochio.figures that has its name."""

from collections.abc import Sequence
from importlib import import_module

from pinnochio.columns import read_table
from pinnochio.logs import attach_log


def render_table(table: str, figure: str, pictures: Sequence[str]) -> None:
    """Draw the table to every path, whose ending says the format."""
    module = import_module(f"pinnochio.figures.{figure}")
    module.draw(read_table(table, module.COLUMNS), pictures)


if __name__ == "__main__":
    attach_log(snakemake.log[0])
    render_table(
        table=snakemake.input.table,
        figure=snakemake.wildcards.table,
        pictures=[snakemake.output.picture, snakemake.output.drawing],
    )
