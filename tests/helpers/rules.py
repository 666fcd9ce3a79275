"""What the rules of core and studies say, read from their text."""

import re
from functools import cache
from pathlib import Path

from pinnochio.code import ROOT

RULE_FILES = sorted([*ROOT.glob("rules/*.smk"), *ROOT.glob("workflow/studies/*/rules.smk")])


def bodies(file: Path) -> dict[str, str]:
    """Text of each rule of a file by the rule's name."""
    blocks = re.split(r"^rule (\w+):\n", file.read_text(encoding="utf-8"), flags=re.M)
    return dict(zip(blocks[1::2], blocks[2::2], strict=True))


@cache
def scripts_of_rules() -> dict[str, str]:
    """Dotted name of each rule's script."""
    scripts = {}
    for file in RULE_FILES:
        for rule, body in bodies(file).items():
            if script := re.search(r'^    script:\n        "(.+)"', body, re.M):
                scripts[rule] = dotted(file.parent / script[1])
        for rule, other in re.findall(r"^use rule (\w+) as (\w+)", file.read_text(encoding="utf-8"), re.M):
            scripts[other] = scripts[rule]
    return scripts


def dotted(path: Path) -> str:
    """The name by which a stage script is imported."""
    parts = path.resolve().relative_to(ROOT).with_suffix("").parts
    return ".".join(parts[1:] if parts[0] == "workflow" else parts)
