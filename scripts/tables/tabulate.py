"""Makes a table, as CSV and its readable twins, by the module of the library that knows it."""

from collections.abc import Mapping
from importlib import import_module

from pinnochio.logs import attach_log
from pinnochio.tables.formats import write_table


def tabulate(module: str, arguments: Mapping, table: str) -> None:
    """Write what `tabulate` of the module makes of its arguments, the files that it reads among them."""
    write_table(import_module(module).tabulate(**arguments), table)


if __name__ == "__main__":
    attach_log(snakemake.log[0])
    tabulate(
        module=snakemake.params.module,
        arguments={**dict(snakemake.input.items()), **snakemake.params.arguments},
        table=snakemake.output.table,
    )
