"""The parts of the stability sweep, a job each."""

from collections.abc import Mapping, Sequence

from studies.stability.table import FAMILIES, OF_PATIENTS


def parts(section: Mapping, cases: Sequence[str]) -> dict[str, dict[str, str]]:
    """Family, case and way of each part by its name; section: `stability` of the configuration."""
    ways = {"translation": section["directions"], "rotation": section["axes"], "rough": ["back"]}
    named = {}
    for family in FAMILIES:
        moved = family in OF_PATIENTS
        for case in cases[: section["patients"]] if moved else ["block"]:
            for way in ways.get(family, ["-"]) if section[family] else []:
                name = "_".join([family, *([case, way] if moved else [])]).removesuffix("_-")
                named[name] = {"family": family, "case": case, "way": way}
    return named
