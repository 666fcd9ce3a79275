"""The settings of the simulated outcome, and what makes it other than any method's computation: every effect."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

from pinnochio.mechanics.settings import FemSettings

NOMINAL = "nominal"


class Effect(NamedTuple):
    """An effect of the outcome; `nominal` is the value that switches it off, None where the outcome's settings hold."""

    meaning: str
    unit: str
    source: str
    nominal: Any


EFFECTS = {
    "nodes": Effect("mesh of this many nodes that lies elsewhere than the methods'", "", "[I]", None),
    "poisson": Effect("Poisson's ratio", "", "[R] 0.46 to 0.49 in the literature", None),
    "stiffening": Effect("second (quadratic) term of a strain-stiffening law", "kPa", "[R] Nazari: c20 1.18 kPa", 0.0),
    "stiffness_spread": Effect(
        "SD of the logarithm of each tissue's modulus over patients",
        "",
        "[S: hal-01092748] wide; size [I]",
        0.0,
    ),
    "sliding_band_factor": Effect("true sliding extent over the methods'", "", "[I]", 1.0),
    "execution_error": Effect("error of carrying out the plan, times the published one", "", "[S: PMC8432567]", 0.0),
    "lip_change": Effect(
        "systematic change of lips and nasal base, times its default", "", "[S: PMC6173856] alar width; lips [I]", 0.0
    ),
    "swelling": Effect("residual swelling at its centre, mean of the cohort", "mm", "[R] a tenth at 3 months", 0.0),
    "expression": Effect(
        "SD of the mouth corners' motion at the scan", "mm", "[S: readbyqxmd 27131258] lip rest 0.25-0.34 mm", 0.0
    ),
    "noise": Effect("SD of the scan noise along the normals", "mm", "[R] stereophotogrammetry, below 0.5 mm", 0.0),
    "holes": Effect("holes of 2 to 5 mm radius in the scan (hair, shine)", "", "[I]", 0),
    "coverage": Effect(
        "smallest cosine between normal and camera that is seen; 6 mm of the rim are lost", "", "[R] two cameras", None
    ),
    "frame": Effect("scanner frame off by up to this many times 8 mm and 6 degrees", "", "[I]", 0.0),
}
SCAN = ("expression", "noise", "holes", "coverage", "frame")  # what changes the scan, not the patient


@dataclass(frozen=True)
class OutcomeSettings:
    """The settings of the outcome, which no method reads: the section `virtual.outcome` of the configuration.

    effects: value of every effect by name, nominal ones resolved. mesh, interfaces: as the sections of these names;
    fem: the mechanics before any effect.
    """

    effects: Mapping[str, Any]
    mesh: Mapping[str, float]
    interfaces: Mapping[str, float]
    fem: FemSettings

    @classmethod
    def of(cls, section: Mapping[str, Any]) -> "OutcomeSettings":
        """From the section of the configuration."""
        return cls(
            effects=resolve(section["effects"]),
            mesh=section["mesh"],
            interfaces=section["interfaces"],
            fem=FemSettings(**section["fem"]),
        )


def resolve(effects: str | Mapping[str, Any]) -> dict[str, Any]:
    """Value of every effect of the config section `virtual.outcome.effects`, with :data:`NOMINAL` replaced."""
    asked = dict.fromkeys(EFFECTS, NOMINAL) if effects == NOMINAL else effects
    return {name: effect.nominal if asked[name] == NOMINAL else asked[name] for name, effect in EFFECTS.items()}


def alone(effects: Mapping[str, Any], effect: str) -> dict[str, Any]:
    """These effects with one on and all others nominal."""
    return resolve(dict.fromkeys(EFFECTS, NOMINAL) | {effect: effects[effect]})
