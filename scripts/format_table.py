"""Makes the readable twins of a table, in Markdown, LaTeX and HTML, of its document."""

from pinnochio.logs import attach_log
from pinnochio.tables.formats import write_twins

if __name__ == "__main__":
    attach_log(snakemake.log[0])
    write_twins(document=snakemake.input.document)
