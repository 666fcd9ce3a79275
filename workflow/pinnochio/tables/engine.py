"""The tables of a study: column schemas, one row per case and method, and files in four formats."""

import html
import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

from pinnochio.errors import InputError
from pinnochio.files import replacing
from pinnochio.metrics.regions import LANDMARKS, REGIONS


@dataclass(frozen=True)
class Column:
    """A column: kind str | int | float | bool; `format` as in format(); optional ones may be empty."""

    name: str
    kind: type
    unit: str
    description: str
    format: str = ""
    optional: bool = False

    @property
    def summary(self) -> str:
        """Format of a mean of the column."""
        return SHOWN if self.format == TESTED else self.format

    def text(self, value) -> str:
        """A value as every file shows it; empty for NaN."""
        return "" if pd.isna(value) else format(self.kind(value), self.format)


SHOWN, TESTED = ".4f", ".7f"  # what is tested has digits enough for rounding not to make ties


def number(name: str, unit: str, description: str, form: str = SHOWN) -> Column:
    """A column of numbers, any of which may be missing."""
    return Column(name, float, unit, description, form, optional=True)


def words(name: str) -> str:
    """A name as it is read."""
    return name.replace("_", " ")


CASES = (
    Column("case", str, "", "patient"),
    Column("fold", str, "", "fold in which the patient was held out"),
    Column("method", str, "", "method that predicted"),
    Column("seed", int, "", "seed of the study"),
    Column("device", str, "", "device that predicted"),
    Column("code", str, "", "content hash of the code"),
    Column("muscle", str, "", "where the muscle layer comes from: labelled, derived (by rule) or single (no layer)"),
    number("cd", "mm", "half the sum of the two directed mean point-to-triangle distances", TESTED),
    number("cd_sum", "mm", "sum of the two directed means"),
    number("cd_sq", "mm2", "mean squared distance, both directions averaged"),
    number("cd_vertex", "mm", "as cd, from vertex to nearest vertex"),
    number("hd95", "mm", "larger of the two directed 95th percentiles"),
    number("hdmax", "mm", "larger of the two directed maxima"),
    number("hd_mean_oneway", "mm", "mean distance of the target's vertices from the prediction"),
    number("pwr1", "%", "predicted area within 1 mm of the target", ".3f"),
    number("pwr2", "%", "predicted area within 2 mm of the target", ".3f"),
    number("pwr1_target", "%", "target area within 1 mm of the prediction", ".3f"),
    number("pwr2_target", "%", "target area within 2 mm of the prediction", ".3f"),
    number("min_jacobian", "", "smallest det F of an element"),
    number("p1_jacobian", "", "1st percentile of det F"),
    number("inverted", "", "elements with det F <= 0", ".0f"),
    number("raw_min_jacobian", "", "min_jacobian before the inversion repair of a learned method"),
    number("raw_inverted", "", "inverted before the inversion repair", ".0f"),
    number("repaired", "", "elements that the inversion repair solved again", ".0f"),
    number("damping", "", "factor of the inversion repair on the whole field, 1 for none"),
    number("volume_change_muscle", "%", "change of the muscle's volume"),
    number("volume_change_superficial", "%", "change of the superficial tissue's volume"),
    number("eqres_paper", "mN2", "mean squared residual force of the free nodes", ".4g"),
    number("eqres_rms", "mN", "root of the mean squared residual force of the free nodes", ".4g"),
    number("eqres_rel", "", "residual force of the free nodes over the force of all others", ".4g"),
    number("eqres_disp", "mm", "mean displacement that a free node still wants", ".4g"),
    Column("eqres_element", str, "", "element of the residual", optional=True),
    number("moving_error", "mm", "mean error of the moving nodes against the plan"),
    number("sliding_error", "mm", "mean change of the sliding nodes' distance from the moved bone"),
    number("interface_error", "mm", "mean distance of the bone contact from where the interface network puts it"),
    *(
        column
        for name in REGIONS
        for column in (
            number(f"region_{name}", "mm", f"mean distance of the target's points on the {words(name)}", TESTED),
            number(f"bias_{name}", "mm", "the same, signed: positive where the prediction lies outside the target"),
        )
    ),
    number("volume_error_mean", "mm", "mean error over the tissue's volume against the virtual truth", TESTED),
    number("volume_error_p95", "mm", "95th percentile of it"),
    number("skin_error_mean", "mm", "mean error over the skin's area against the virtual truth", TESTED),
    number("skin_error_p95", "mm", "95th percentile of it"),
    *(
        number(f"landmark_{name}", "mm", f"error at {words(name)} against the virtual truth", TESTED)
        for name in LANDMARKS
    ),
    number("seconds", "s", "one plan, warm, without reading files", ".3f"),
    number("setup_seconds", "s", "what belongs to the patient and serves every plan", ".3f"),
    Column("threads", int, "", "CPU threads; 0 where unknown"),
    Column("nodes", int, "", "nodes of the mesh"),
    Column("converged", bool, "", "whether the solver converged; true where there is none"),
    Column("reason", str, "", "why the solver stopped", optional=True),
    number("registration_residual", "mm", "median residual of the scan's registration"),
)


def check(frame: pd.DataFrame, schema: Sequence[Column], file: object = "table") -> pd.DataFrame:
    """The frame with the schema's columns in order and kind; InputError names the column that does not fit."""

    def refuse(problem: str):
        raise InputError("-", file, problem, "make the table again with the code that reads it")

    names = [column.name for column in schema]
    if missing := [name for name in names if name not in frame]:
        refuse(f"column {missing[0]!r} is missing")
    if extra := [name for name in frame if name not in names]:
        refuse(f"column {extra[0]!r} is not in the schema")
    if frame.empty:
        refuse("it has no row")
    checked = {}
    for column in schema:
        values = frame[column.name]
        empty = values.isna() | (values.astype(object) == "")
        if empty.any() and not column.optional:
            refuse(f"column {column.name!r} has an empty cell")
        if column.kind is str:
            checked[column.name] = values.astype(object).where(~empty, "").map(str)
            continue
        plain = values.astype(object).where(~empty, np.nan)
        numbers = pd.to_numeric(plain.replace({"True": True, "False": False}), errors="coerce").astype(float)
        if (numbers.isna() & ~empty).any():
            refuse(f"column {column.name!r} holds something that is not a number")
        if column.kind is not float and (numbers % 1 != 0).any():
            refuse(f"column {column.name!r} holds a number that is not whole")
        if column.kind is bool and not numbers.isin([0, 1]).all():
            refuse(f"column {column.name!r} holds something that is neither True nor False")
        checked[column.name] = numbers.astype(column.kind)
    return pd.DataFrame(checked).reset_index(drop=True)


def read_table(path: str | os.PathLike, schema: Sequence[Column]) -> pd.DataFrame:
    """Read and check a CSV table."""
    return check(pd.read_csv(path, dtype=str, keep_default_na=False), schema, path)


def scanned(cases: pd.DataFrame) -> pd.DataFrame:
    """The rows of CASES whose patient has a post-operative scan."""
    return cases[cases["registration_residual"].notna()]


def write_csv(frame: pd.DataFrame, path: str | os.PathLike, schema: Sequence[Column]) -> pd.DataFrame:
    """Check and write a table as CSV, floats in the schema's format; returns the checked frame."""
    frame = check(frame, schema, path)
    text = pd.DataFrame({column.name: frame[column.name].map(column.text) for column in schema})
    with replacing(path) as temporary:
        text.to_csv(temporary, index=False, lineterminator="\n")
    return frame


def write_cases(frame: pd.DataFrame, path: str | os.PathLike, cohort: str = "virtual cohort") -> None:
    """Write cases.csv, sorted by case and method, and its twins beside it."""
    frame = write_csv(frame.sort_values(["case", "method"], kind="stable"), path, CASES)
    view = views(CASES, {c.name: f"{c.name} [{c.unit}]" if c.unit else c.name for c in CASES})
    caption = f"One row per case and method; {cohort}, {frame['case'].nunique()} patients."
    write_twins(frame, path, view, caption, CASES)


@dataclass(frozen=True)
class View:
    """A column of the readable twins: header, text of a row, and whether large (+1) or small (-1) is best (0: none)."""

    header: str
    text: Callable
    sign: int = 0

    def bold(self, texts: Sequence[str]) -> np.ndarray:
        """Rows (n,) bool that are best as shown, all of them in a tie; none in a table of one row."""
        if not self.sign or len(texts) < 2:
            return np.zeros(len(texts), bool)
        values = self.sign * np.array([float(text.split()[0]) if text else np.nan for text in texts])
        return values == np.nanmax(values) if np.isfinite(values).any() else np.zeros(len(texts), bool)


def views(schema: Sequence[Column], headers: Mapping[str, str], signs: Mapping[str, int] | None = None) -> list[View]:
    """Columns as the CSV file writes them, under headers by their names; signs: of those in which something is best."""
    columns = {column.name: column for column in schema}

    def text(name):
        return lambda row: columns[name].text(row[name])

    return [View(header, text(name), (signs or {}).get(name, 0)) for name, header in headers.items()]


@dataclass(frozen=True)
class Block:
    """A table of the readable twins: rows of a frame as a view shows them, with a caption.

    title: what sets a further table apart from the one above it.
    """

    frame: pd.DataFrame
    view: Sequence[View]
    caption: str
    title: str = ""

    @property
    def headers(self) -> list[str]:
        return [column.header for column in self.view]

    def cells(self, cell: Callable[[str, bool], str]) -> list[list[str]]:
        """Every row's texts as cell(text, bold) writes them."""
        columns = [[str(column.text(row)) for row in self.frame.to_dict("records")] for column in self.view]
        bold = [column.bold(texts) for column, texts in zip(self.view, columns, strict=True)]
        return [
            [cell(*pair) for pair in zip(*row, strict=True)]
            for row in zip(zip(*columns, strict=True), zip(*bold, strict=True), strict=True)
        ]


def write_twins(
    frame,
    path,
    view: Sequence[View],
    caption: str,
    schema: Sequence[Column],
    further: Sequence[Block] = (),
    paragraphs: Sequence[str] = (),
) -> None:
    """Write Markdown, LaTeX and HTML beside the CSV `path`, with the same numbers as the CSV.

    further: tables below the CSV's own; paragraphs: plain text below all tables.
    """
    blocks = [Block(frame, view, caption), *further]
    for suffix, render in ((".md", _markdown), (".tex", _latex), (".html", _html)):
        with replacing(Path(path).with_suffix(suffix)) as temporary:
            temporary.write_text(render(blocks, paragraphs, schema), encoding="utf-8")


def _markdown(blocks, paragraphs, schema) -> str:
    def cell(text, strong):
        text = text.replace("|", "\\|").replace("*", "\\*")
        return f"**{text}**" if strong and text else text

    parts = []
    for block in blocks:
        lines = [block.headers, ["---"] * len(block.headers), *block.cells(cell)]
        parts += [f"**{block.title}**"] if block.title else []
        parts += ["\n".join("| " + " | ".join(line) + " |" for line in lines), block.caption]
    return "\n\n".join([*parts, *paragraphs]) + "\n"


def _latex(blocks, paragraphs, schema) -> str:
    special = {c: f"\\{c}" for c in "&%$#_{}"} | {"\\": r"\textbackslash{}", "±": r"$\pm$"}
    special |= {"~": r"\textasciitilde{}", "^": r"\textasciicircum{}", "<": "$<$", ">": "$>$"}

    def escape(text):
        return "".join(special.get(character, character) for character in text)

    def cell(text, strong):
        return f"\\textbf{{{escape(text)}}}" if strong and text else escape(text)

    parts = []
    for block in blocks:
        head = [escape(header) for header in block.headers]
        caption = f"{block.title}. {block.caption}" if block.title else block.caption
        lines = [" & ".join(row) + r" \\" for row in [head, *block.cells(cell)]]
        parts.append(
            "\n".join(
                [r"\begin{table}", r"\centering", f"\\caption{{{escape(caption)}}}"]
                + [f"\\begin{{tabular}}{{l{'r' * (len(head) - 1)}}}", r"\hline", lines[0], r"\hline", *lines[1:]]
                + [r"\hline", r"\end{tabular}", r"\end{table}"]
            )
        )
    return "\n\n".join([*parts, *map(escape, paragraphs)]) + "\n"


STYLE = """body{font:15px/1.5 system-ui,sans-serif;margin:2rem;color:#222;background:#fff}
.scroll{overflow-x:auto}h2{font-size:1.1rem;margin:2.5rem 0 .5rem}p{max-width:60rem;margin-top:1.5rem}
table{border-collapse:collapse;font-variant-numeric:tabular-nums}
caption{text-align:left;padding-bottom:.8rem;max-width:60rem}th{border-bottom:2px solid #444;text-align:left}
th,td{padding:.3rem .8rem;white-space:nowrap}td:not(:first-child){text-align:right}
tbody tr:nth-child(even){background:#f4f4f2}details{margin-top:1.5rem}dt{font-weight:600;margin-top:.4rem}"""


def _html(blocks, paragraphs, schema) -> str:
    def cell(text, strong):
        text = html.escape(text)
        return f"<td><b>{text}</b></td>" if strong and text else f"<td>{text}</td>"

    parts = []
    for block in blocks:
        head = "".join(f"<th>{html.escape(header)}</th>" for header in block.headers)
        body = "\n".join("<tr>" + "".join(row) + "</tr>" for row in block.cells(cell))
        parts += [f"<h2>{html.escape(block.title)}</h2>"] if block.title else []
        parts.append(
            f"<div class='scroll'><table><caption>{html.escape(block.caption)}</caption>\n"
            f"<thead><tr>{head}</tr></thead>\n<tbody>\n{body}\n</tbody></table></div>"
        )
    parts += [f"<p>{html.escape(text)}</p>" for text in paragraphs]
    legend = "".join(
        f"<dt>{html.escape(c.name)}</dt><dd>{html.escape(c.description)}{f' [{c.unit}]' if c.unit else ''}</dd>"
        for c in schema
    )
    title = html.escape(blocks[0].caption.split(":")[0].split(";")[0])
    return (
        f'<!doctype html>\n<html lang="en"><head><meta charset="utf-8"><title>{title}</title>\n'
        f"<style>{STYLE}</style></head><body>\n" + "\n".join(parts) + "\n"
        f"<details><summary>Columns of the CSV file</summary><dl>{legend}</dl></details>\n</body></html>\n"
    )
