"""A table as files: its rows as CSV, and its readable twins as Markdown, LaTeX and HTML."""

import os
from pathlib import Path

import jinja2

from pinnochio.columns import write_csv
from pinnochio.files import replacing
from pinnochio.methods.names import spoken
from pinnochio.tables.document import Block, Table
from pinnochio.web_pages import write_page

HTML = "table.html"  # beside this module

MARKDOWN = """\
{% for block in blocks -%}
{% if block.title %}**{{ block.title }}**

{% endif -%}
| {{ block.headers | join(" | ") }} |
| {{ (["---"] * (block.headers | length)) | join(" | ") }} |
{% for row in block.rows -%}
|{% for text, bold, _ in row %} {{ "**" if bold }}{{ text | escaped }}{{ "**" if bold }} |{% endfor %}
{% endfor %}
{{ block.caption }}
{% if not loop.last %}
{% endif -%}
{% endfor -%}
{% for paragraph in paragraphs %}
{{ paragraph }}
{% endfor -%}
"""
LATEX = r"""
<%- for block in blocks -%>
\begin{table}
\centering
\caption{<< block.title ~ ". " if block.title >><< block.caption >>}
\begin{tabular}{l<< "r" * (block.headers | length - 1) >>}
\hline
<% for header in block.headers %><% if not loop.first %> & <% endif %><< header >><% endfor %> \\
\hline
<% for row in block.rows -%>
<% for text, bold, _ in row -%>
<% if not loop.first %> & <% endif %><% if bold %>\textbf{<< text >>}<% else %><< text >><% endif %>
<%- endfor %> \\
<% endfor -%>
\hline
\end{tabular}
\end{table}
<% if not loop.last %>
<% endif -%>
<% endfor -%>
<% for paragraph in paragraphs %>
<< paragraph >>
<% endfor -%>
"""
SPECIAL = str.maketrans(
    {character: f"\\{character}" for character in "&%$#_{}"}
    | {"\\": r"\textbackslash{}", "±": r"$\pm$", "<": "$<$", ">": "$>$"}
    | {"~": r"\textasciitilde{}", "^": r"\textasciicircum{}"}
)


def _markdown() -> jinja2.Template:
    environment = jinja2.Environment(keep_trailing_newline=True)
    environment.filters["escaped"] = lambda text: text.replace("|", "\\|").replace("*", "\\*")
    return environment.from_string(MARKDOWN)


def _latex() -> jinja2.Template:
    """Every value is escaped; the marks of its template are none of LaTeX's own."""
    return jinja2.Environment(
        block_start_string="<%",
        block_end_string="%>",
        variable_start_string="<<",
        variable_end_string=">>",
        finalize=lambda value: str(value).translate(SPECIAL),
        keep_trailing_newline=True,
    ).from_string(LATEX)


FORMATS = {".md": _markdown, ".tex": _latex}


def write_table(table: Table, path: str | os.PathLike) -> None:
    """Write the rows of a table as CSV, and beside them its twins: Markdown, LaTeX and HTML."""
    write_csv(table.frame, path, table.columns)
    shown = {
        "blocks": [_spoken(block) for block in table.blocks],
        "paragraphs": [spoken(text) for text in table.paragraphs],
        "columns": table.columns,
    }
    for suffix, template in FORMATS.items():
        with replacing(Path(path).with_suffix(suffix)) as temporary:
            temporary.write_text(template().render(shown), encoding="utf-8")
    write_page(Path(path).with_suffix(".html"), Path(__file__).with_name(HTML), **shown)


def _spoken(block: Block) -> dict:
    """The block with methods by the names that people write; each cell is (text, whether it is bold, text of the CSV
    file)."""
    rows = [[(spoken(text), bold, text) for text, bold in row] for row in block.rows]
    title, caption = spoken(block.title), spoken(block.caption)
    return {"headers": block.headers, "rows": rows, "title": title, "caption": caption}
