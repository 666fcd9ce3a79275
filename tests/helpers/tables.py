"""Tables as the rules make them: CSV file and readable twins."""

import re
from pathlib import Path

from pinnochio.tables.document import Table
from pinnochio.tables.formats import write_table
from scripts.tables.tabulate import tabulate


def write(table: Table, path: Path) -> None:
    """Write a table and its twins beside the path of its CSV file."""
    write_table(table, path)


def make(path: Path, module: str, **arguments) -> None:
    """The same of the table that a module makes of files and arguments."""
    tabulate(module, arguments, str(path))


def texts(drawing: Path) -> str:
    """The words of an SVG picture, line after line."""
    return " ".join(re.findall(r"<!-- (.*?) -->", drawing.read_text(), re.DOTALL)).replace("\n", " ")
