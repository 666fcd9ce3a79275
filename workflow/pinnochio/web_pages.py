"""HTML pages: every template extends base.html, which holds the one style, and needs no other file when it is made."""

from pathlib import Path

import jinja2

from pinnochio.files import replacing

BASE = Path(__file__).with_name("base.html")


def render(template: Path, **values) -> str:
    """The page of a template file; what it includes lies beside it. Values are escaped."""
    loader = jinja2.FileSystemLoader([template.parent, BASE.parent])
    environment = jinja2.Environment(loader=loader, autoescape=True, keep_trailing_newline=True)
    return environment.get_template(template.name).render(values)


def write_page(path: str | Path, template: Path, **values) -> None:
    """Write that page."""
    with replacing(path) as temporary:
        temporary.write_text(render(template, **values), encoding="utf-8")
