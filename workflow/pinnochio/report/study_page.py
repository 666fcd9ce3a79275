"""What the page of a study holds of tables, pictures and captions, so that it needs no other file."""

import base64
import gzip
import io
import os
import re
from collections.abc import Mapping
from pathlib import Path

import PIL.Image

from pinnochio.errors import InputError, damaged
from pinnochio.json_text import read_stored_text

TEMPLATE = Path(__file__).with_name("study_page.html")  # it includes "view.js", named here for its hash
SMALL = 480  # pixels, the width of a picture that is one of many


def cohort_of(config: Mapping) -> str:
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


def packed(text: str) -> str:
    """The text as a page carries it where it is long: gzip, as base64; `unpacked` of view.js reads it."""
    return base64.b64encode(gzip.compress(text.encode(), 9, mtime=0)).decode()


def paragraphs(caption: str) -> list[str]:
    """Paragraphs of a caption."""
    return [" ".join(paragraph.split()) for paragraph in caption.strip().split("\n\n")]


def picture(path: str | os.PathLike) -> str:
    """The address of a drawn PNG, as WebP that loses nothing: a third of the size."""
    return _webp(path, lossless=True)


def photograph(path: str | os.PathLike, width: int | None = None) -> str:
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
