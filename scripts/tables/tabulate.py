"""Makes a table, as CSV and as the document of its readable twins, by the module of the library that knows it."""

from collections.abc import Mapping
from importlib import import_module

from pinnochio.logs import attach_log


def tabulate(module: str, arguments: Mapping, table: str, document: str) -> None:
    """Write what `tabulate` of the module makes of its arguments, the files that it reads among them."""
    import_module(module).tabulate(**arguments).write(table=table, document=document)


if __name__ == "__main__":
    attach_log(snakemake.log[0])
    tabulate(
        module=snakemake.params.module,
        arguments={**dict(snakemake.input.items()), **snakemake.params.arguments},
        table=snakemake.output.table,
        document=snakemake.output.document,
    )
