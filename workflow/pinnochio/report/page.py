"""The page itself: tables, figures, patients and provenance of a study in one HTML file that needs nothing else."""

import base64
import io
import json
import os
import re
from collections.abc import Mapping
from pathlib import Path

import jinja2
import PIL.Image
from plotly.offline import get_plotlyjs

from pinnochio.errors import InputError
from pinnochio.files import replacing
from pinnochio.report.parts import PARTS
from pinnochio.tables.formats import STYLE

TEMPLATE, PROGRAM = "page.html", "view.js"  # beside this module; the template includes the program


def write_page(
    captions: Mapping[str, str],
    tables: Mapping[str, str],
    figures: Mapping[str, Mapping[str, str]],
    patients: Mapping[str, Mapping[str, str]],
    provenance: str | os.PathLike,
    path: str | os.PathLike,
) -> None:
    """Write the page.

    captions: of each part, of a `picture` and of a `volume`, plain paragraphs. tables: HTML twins by part; figures: PNG
    files by part and name; patients: by case the files of its `picture`, its `view` and, where there is one, its
    `volume`.
    """
    record = json.loads(Path(provenance).read_text(encoding="utf-8"))
    parts = [
        {
            "name": name,
            "title": title,
            "words": _words(captions[name]),
            "table": read_body(tables[name]) if name in tables else "",
            "pictures": {label: _picture(file) for label, file in figures.get(name, {}).items()},
        }
        for name, title in PARTS.items()
        if name in tables or name in figures
    ]
    shown = {
        case: {
            "pictures": {name: _photograph(files[name]) for name in ("picture", "volume") if name in files},
            "view": json.loads(Path(files["view"]).read_text(encoding="utf-8")),
        }
        for case, files in patients.items()
    }
    environment = jinja2.Environment(loader=jinja2.FileSystemLoader(Path(__file__).parent), autoescape=True)
    text = environment.get_template(TEMPLATE).render(
        style=STYLE,
        parts=parts,
        patients=shown,
        words={name: _words(captions[name]) for name in ("picture", "volume")},
        record=record,
        study=_cohort(record["config"]),
        virtual=record["config"]["cohort"] == "virtual",
        plotly=get_plotlyjs() if shown else "",
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
    body = re.search(r"<body>(.*)</body>", Path(path).read_text(encoding="utf-8"), re.DOTALL)
    if not body:
        raise InputError("-", path, "it is not the HTML twin of a table", "make the table again")
    return body[1]


def _words(caption: str) -> list[str]:
    """Paragraphs of a caption."""
    return [" ".join(paragraph.split()) for paragraph in caption.strip().split("\n\n")]


def _picture(path: str | os.PathLike) -> str:
    """The address of a PNG as it is."""
    return _address(Path(path).read_bytes(), "png")


def _photograph(path: str | os.PathLike) -> str:
    """The address of a rendered PNG, as WebP: a tenth of the size, and no difference to the eye."""
    written = io.BytesIO()
    PIL.Image.open(path).save(written, "WEBP", quality=85)
    return _address(written.getvalue(), "webp")


def _address(content: bytes, kind: str) -> str:
    return f"data:image/{kind};base64,{base64.b64encode(content).decode()}"
