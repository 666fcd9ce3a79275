"""Makes the picture of a table by the module that knows it."""

from collections.abc import Sequence
from importlib import import_module

from pinnochio.columns import read_table
from pinnochio.logs import attach_log


def render_table(table: str, module: str, pictures: Sequence[str]) -> None:
    """Draw the table to every path, whose ending says the format, by `draw` of the module."""
    figure = import_module(module)
    figure.draw(read_table(table, figure.COLUMNS), pictures)


if __name__ == "__main__":
    attach_log(snakemake.log[0])
    render_table(
        table=snakemake.input.table,
        module=snakemake.params.module,
        pictures=[snakemake.output.picture, snakemake.output.drawing],
    )
