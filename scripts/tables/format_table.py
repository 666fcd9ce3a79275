"""Makes the readable twins of a table, in Markdown, LaTeX and HTML, of its document."""

from pinnochio.logs import attach_log
from pinnochio.tables.formats import write_twins


def format_table(document: str) -> None:
    """Write them beside the document."""
    write_twins(document)


if __name__ == "__main__":
    attach_log(snakemake.log[0])
    format_table(document=snakemake.input.document)
