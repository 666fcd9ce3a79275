"""The pages of the project, their commands and their named blocks."""

import re
import shlex
from pathlib import Path

from tests.helpers.settings import ROOT

PAGES = [
    *(ROOT / f"{folder}README.md" for folder in ("", "config/", "models/", "results/")),
    *sorted((ROOT / "docs").rglob("*.md")),
    *sorted((ROOT / "workflow/studies").glob("*/README.md")),
]
FENCE = re.compile(r"^ *```(\w*)\n(.*?)^ *```", re.M | re.S)
# What the pages leave to the reader to fill in.
FILLED_IN = {
    "patient=FOLDER": "patient=P01",
    "path/to/archive": "results/archive",
    "path/to/folder": "elsewhere",
    "NAME": "ours",
    "{nodes}": "500",
    "[--device cuda]": "--device cuda",
}


def bash_blocks(page: Path) -> list[str]:
    """The bash blocks of a page in their order, as a reader types them."""
    return [block for language, block in FENCE.findall(page.read_text(encoding="utf-8")) if language == "bash"]


def commands(page: Path) -> set[tuple[str, ...]]:
    """The commands of a page, filled in: lines of its bash blocks, and code that begins with a program or an option."""
    text, lines = page.read_text(encoding="utf-8"), []
    for block in bash_blocks(page):
        lines += block.replace("\\\n", " ").splitlines()
    for span in (" ".join(span.split()) for span in re.findall(r"`([^`]+)`", FENCE.sub("", text))):
        if re.match(r"(snakemake|make|python) ", span):
            lines.append(span)
        elif re.match(r"--(config|configfile|resources|default-resources) ", span):
            lines.append(f"snakemake {span}")
        elif re.match(r"\w+\.py -", span):
            lines.append(f"python tests/benchmarks/{span}")
    for place, filled_in in FILLED_IN.items():
        lines = [command.replace(place, filled_in) for command in lines]
    lines = [re.sub(r" --cores \d+", "", command) for command in lines]
    return {tuple(shlex.split(command, comments=True)) for command in lines} - {()}


def named_blocks(page: Path) -> dict[str, str]:
    """The blocks of a page whose first line is a comment that names their file, by that name."""
    blocks = (block.partition("\n") for _, block in FENCE.findall(page.read_text(encoding="utf-8")))
    return {first[2:]: rest for first, _, rest in blocks if re.fullmatch(r"# [\w./]+\.\w+", first)}
