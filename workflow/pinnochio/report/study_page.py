"""The page itself: tables, figures, patients and provenance of a study in one HTML file that needs nothing else."""

import base64
import gzip
import io
import os
import re
from collections.abc import Mapping, Sequence
from pathlib import Path

import PIL.Image
from plotly.offline import get_plotlyjs

from pinnochio.columns import read_table
from pinnochio.errors import InputError, damaged
from pinnochio.files import replacing
from pinnochio.json_text import read_stored_json, read_stored_text
from pinnochio.methods.names import written
from pinnochio.metrics.case_columns import CASES, scanned
from pinnochio.report.answer import sentences
from pinnochio.report.parts import FOLDED
from pinnochio.statistics.ranking import rank
from pinnochio.web_pages import render

TEMPLATE, PROGRAM = "study_page.html", "view.js"  # beside this module; the template includes the program
SMALL = 480  # pixels, the width of a picture that is one of many


def write_page(
    titles: Mapping[str, str],
    captions: Mapping[str, str],
    tables: Mapping[str, str],
    figures: Mapping[str, Mapping[str, str]],
    patients: Mapping[str, Mapping[str, str]],
    provenance: str | os.PathLike,
    path: str | os.PathLike,
    cases: str | os.PathLike | None = None,
    methods: Sequence[str] = (),
    chart: str | os.PathLike | None = None,
    qualities: Mapping[str, str] | None = None,
) -> None:
    """Write the page.

    titles: of the parts, in the order of the page. captions: of each part, of a `picture` and of a `volume`, plain
    paragraphs. tables: HTML twins by part; figures: PNG files by part and name; patients: by case the files of its
    `picture`, its `view` and, where there is one, its `volume`. cases: the table of CASES that the three sentences on
    top are made from, with the methods that they compare; chart: the picture under them; these are absent where no
    patient has a scan. qualities: by case the picture of its model.
    """
    record = read_stored_json(provenance)
    settings, study = record["config"], _cohort(record["config"])
    ranking = rank(scanned(read_table(cases, CASES)), methods, settings["seed"]) if cases else None
    parts = [
        {
            "name": name,
            "title": title,
            "folded": name in FOLDED,
            "words": _words(captions[name]),
            "table": rounded(read_body(tables[name])) if name in tables else "",
            "pictures": {written(label): _picture(file) for label, file in figures.get(name, {}).items()},
        }
        for name, title in titles.items()
        if name in tables or name in figures
    ]
    shown = {
        case: {
            "pictures": {name: _photograph(files[name]) for name in ("picture", "volume") if name in files},
            "view": read_stored_json(files["view"]),
        }
        for case, files in patients.items()
    }
    text = render(
        Path(__file__).with_name(TEMPLATE),
        said=sentences(ranking, study[0].lower() + study[1:], settings["folds"], settings["motion"]) if ranking else [],
        demonstration=ranking is not None and not ranking.tested,
        chart=_picture(chart) if chart else "",
        qualities={case: _photograph(file, SMALL) for case, file in (qualities or {}).items()},
        written=written,
        parts=parts,
        patients=shown,
        words={name: _words(captions[name]) for name in ("picture", "volume")},
        record=record,
        study=study,
        virtual=settings["cohort"] == "virtual",
        plotly=_packed(get_plotlyjs()) if shown else "",
    )
    with replacing(path) as temporary:
        temporary.write_text(text, encoding="utf-8")


def _cohort(config: Mapping) -> str:
    """What the page calls the cohort."""
    if config["cohort"] == "virtual":
        return f"Virtual cohort ({config['virtual']['role']})"
    return Path(config["cohort"]).stem


def read_body(path: str | os.PathLike) -> str:
    """What stands between the body tags of a table's HTML twin."""
    body = re.search(r"<body>(.*)</body>", read_stored_text(path), re.DOTALL)
    if not body:
        raise InputError("-", path, "it is not the HTML twin of a table", "make the table again")
    return body[1]


def rounded(table: str) -> str:
    """A table with two decimals of numbers that vary by a tenth or more, while the files keep all."""
    return re.sub(r"(?<!\d)(-?\d+\.\d{3,4})(?: ± (\d+\.\d{3,4}))?(?!\d)", _rounded, table)


def _rounded(match: re.Match) -> str:
    """A number of three or four decimals, with its spread where it has one, to two where that is a tenth or more."""
    numbers = [float(text) for text in match.groups() if text]
    return " ± ".join(f"{value:.2f}" for value in numbers) if abs(numbers[-1]) >= 0.1 else match[0]


def _packed(text: str) -> str:
    """The text as a page carries it where it is long: gzip, as base64; `unpacked` of view.js reads it."""
    return base64.b64encode(gzip.compress(text.encode(), 9, mtime=0)).decode()


def _words(caption: str) -> list[str]:
    """Paragraphs of a caption."""
    return [" ".join(paragraph.split()) for paragraph in caption.strip().split("\n\n")]


def _picture(path: str | os.PathLike) -> str:
    """The address of a drawn PNG, as WebP that loses nothing: a third of the size."""
    return _webp(path, lossless=True)


def _photograph(path: str | os.PathLike, width: int | None = None) -> str:
    """The address of a rendered PNG, as WebP, a tenth of the size and no different to the eye; no wider than width."""
    return _webp(path, width, quality=80)


def _webp(path: str | os.PathLike, width: int | None = None, **how) -> str:
    content = io.BytesIO()
    try:
        picture = PIL.Image.open(path)
        picture.load()
    except Exception as error:  # PIL raises OSError, SyntaxError and more
        raise damaged(path, error) from error
    if width and picture.width > width:
        picture = picture.resize((width, round(picture.height * width / picture.width)), PIL.Image.Resampling.LANCZOS)
    picture.save(content, "WEBP", **how)
    return f"data:image/webp;base64,{base64.b64encode(content.getvalue()).decode()}"
