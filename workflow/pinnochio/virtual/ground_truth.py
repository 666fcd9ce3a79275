"""The settings of the simulated outcome, and what makes it other than any method's computation: every effect."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

from pinnochio.mechanics.settings import FemSettings

NOMINAL = "nominal"
MECHANICS, CHANGE, OPEN, MOTION, SCAN = "mechanics", "change", "open", "motion", "scan"


class Effect(NamedTuple):
    """An effect of the outcome.

    nominal: the value that switches it off, None where the outcome's settings hold. kind: of the MECHANICS; a CHANGE of
    the tissue beyond them that plan, anatomy and covariates decide; a change that nothing known decides, which they
    leave OPEN; of the MOTION of the bones; of the SCAN, which leaves the patient as is. noise: what of it no covariate,
    plan or anatomy decides.
    """

    meaning: str
    unit: str
    source: str
    nominal: Any
    kind: str
    noise: str = ""


EFFECTS = {
    "nodes": Effect("mesh of this many nodes that lies elsewhere than the methods', turned and shifted", "", "[I]",
        None, MECHANICS),
    "poisson": Effect("Poisson's ratio", "", "[R] 0.46 to 0.49 in the literature", None, MECHANICS),
    "stiffening": Effect("second (quadratic) term of a strain-stiffening law", "kPa", "[R] Nazari: c20 1.18 kPa", 0.0,
        MECHANICS),
    "yielding": Effect(
        "volume ratio below which tissue that is squeezed between bones yields, as what the surgeon trims or strips",
        "", "[I]", 0.0, MECHANICS),
    "stiffness_spread": Effect("SD of the logarithm of each tissue's modulus over patients", "",
        "[S: hal-01092748] wide; size [I]", 0.0, MECHANICS, "all"),
    "sliding_band_factor": Effect("true sliding extent over the methods'", "", "[I]", 1.0, MECHANICS),
    "pre_stress": Effect(
        "tension of the skin, times one that rises from 7 kPa at mouth and nose to 53 kPa in the cheek", "",
        "[S: 10.1007/978-3-319-59764-5_6]; skin of 1.2 mm [R]", 0.0, MECHANICS, "CV 25 %"),
    "execution_error": Effect("error of carrying out the plan, times the published one", "", "[S: PMC8432567]", 0.0,
        MOTION, "all"),
    "habitual": Effect(
        "what mechanics misses of every patient alike: paranasal skin and the body of the jaw lie outside, the dorsum "
        "of the nose and the middle of the cheek inside", "", "[X] places of three real patients; sizes [I]", 0.0,
        CHANGE),
    "posture": Effect(
        "lying in the CT, upright at the scan: infraorbital and malar skin fall back, the cheek fills, the jaw angle "
        "empties; more with body mass and age", "",
        "[S: readbyqxmd 29396312, n = 53 women, PMC9871103]; cheek and jaw [I]", 0.0, CHANGE),
    "lower_lip": Effect(
        "lower lip unfurls with mandibular advance, more where it is thick or the lips gaped; fills with setback", "",
        "[S: n = 62, 10.1007/978-3-030-32254-0_38, Angle Orthod 80:896]; form [I]", 0.0, CHANGE),
    "chin_pad": Effect("chin pad thins with advance, thickens with setback; the mentolabial fold the other way", "",
        "[S: n = 62]; form [I]", 0.0, CHANGE),
    "upper_lip": Effect(
        "upper lip and base of the nose follow the maxilla less than mechanics has it, the lip less where it is thin; "
        "more with V-Y closure", "", "[S: PMC6173856 Ls 0.21, n = 81; 0.9 with V-Y]; form [I]", 0.0, CHANGE),
    "lip_length": Effect("upper lip lengthens by 0.8 mm, along the skin", "",
        "[S: +0.73 to +1.0 +- 1.9 mm]", 0.0, CHANGE),
    "alar_width": Effect(
        "wings of the nose widen with maxillary advance and impaction, half as much with a cinch suture", "",
        "[S: 10.1186/s13005-015-0080-y, KJO 50(4)]; form [I]", 0.0, CHANGE),
    "paranasal": Effect("skin beside the nose fills with maxillary advance", "", "[I], within [S: TJO 2022.90]", 0.0,
        CHANGE),
    "swelling": Effect("swelling that is left, by months to the scan", "", "[S: PMID 34619733]; regions [I]", 0.0,
        CHANGE),
    "masseter_loss": Effect("masseter and weight lost after surgery: jaw angle, cheek and under the chin", "",
        "[S: -13.5 % of volume, -2.8 kg]; mm [I]", 0.0, CHANGE),
    "response": Effect(
        "the patient's own response, region by region (SD 1.0 mm lower lip, 0.8 mm upper lip, chin and cheek, 0.3 to "
        "0.9 mm elsewhere) and a broad part (SD 0.5 mm over 28 mm), sides correlated by 0.81, times one number per "
        "patient, log SD 0.25", "",
        "[S: n = 57, 62: 1.3-1.65 mm are left at the lip, 0.8 at the chin; symmetry X]; elsewhere [I]", 0.0, OPEN,
        "all"),
    "lengthening": Effect("the upper lip lengthens by more or less than the mean, SD 1.5 mm along the skin", "",
        "[S: +0.73 to +1.0 +- 1.9 mm]", 0.0, OPEN, "all"),
    "gain": Effect(
        "soft tissue follows the bone more or less than mechanics has it: SD 12 % of the motion at lips and beside the "
        "nose, 8 % chin, 5 % cheek", "", "[S: n = 57, 62: individual]; size [I]", 0.0, OPEN, "all"),
    "swelling_level": Effect("swelling is more or less than its month's mean, log SD 0.5", "",
        "[S: PMID 34619733]; SD [I]", 0.0, OPEN, "all"),
    "expression": Effect("another expression at the scan: SD 0.3 mm upper lip, 0.4 mm lower lip, 0.15 mm cheek", "",
        "[S: readbyqxmd 27131258, PMC7064576]; split [I]", 0.0, SCAN, "all"),
    "noise": Effect("SD of the scan noise along the normals", "mm", "[R] stereophotogrammetry, below 0.5 mm", 0.0, SCAN,
        "all"),
    "holes": Effect("holes of 2 to 5 mm radius in the scan (hair, shine)", "", "[I]", 0, SCAN, "all"),
    "coverage": Effect("smallest cosine between normal and camera that is seen; 6 mm of the rim are lost", "",
        "[R] two cameras", None, SCAN),
    "frame": Effect("scanner frame off by up to this many times 8 mm and 6 degrees", "", "[I]", 0.0, SCAN, "all"),
}  # fmt: skip


class Dials(NamedTuple):
    """Factors on the changes, found by `snakemake reality` on calibration patients, then frozen.

    decided: on every CHANGE whose size no publication states, and below one on all of them; open: on what is OPEN.
    """

    decided: float
    open: float


class Reality(NamedTuple):
    """How hard the outcome is, and how much of that could be learned.

    dials by the share (%) of the square of the distance of sliding finite elements, with the true motion, that somebody
    would explain who knew all that is decided. months: mean and SD to the scan. upright: the scan is of an upright
    face, the CT of a lying one. target: mean distance, mm; source of it.
    """

    dials: Mapping[int, Dials]
    months: tuple[float, float]
    upright: bool
    target: float
    source: str


CLINIC, SAME_MODALITY = "clinic", "same_modality"
REALITIES = {
    CLINIC: Reality(
        {10: Dials(0.60, 2.19), 37: Dials(2.03, 1.61), 56: Dials(2.50, 1.20)}, (6.0, 1.5), True,
        1.30, "[S: arXiv 2606.01572] CT to 3dMD, 1.30 ± 0.29"),
    SAME_MODALITY: Reality(
        {10: Dials(0.12, 1.37), 37: Dials(1.21, 1.01), 56: Dials(1.51, 0.76)}, (12.0, 2.0), False,
        0.95, "[S: Liebregts 2015] CBCT to CBCT, 0.9 ± 0.3"),
}  # fmt: skip


@dataclass(frozen=True)
class OutcomeSettings:
    """The settings of the outcome, which no method reads: the section `virtual.outcome` of the configuration.

    effects: value of every effect by name, nominal ones resolved. mesh, interfaces: as the sections of these names;
    fem: the mechanics before any effect.
    """

    effects: Mapping[str, Any]
    dials: Dials
    mesh: Mapping[str, float]
    interfaces: Mapping[str, float]
    fem: FemSettings

    @classmethod
    def of(cls, section: Mapping[str, Any]) -> "OutcomeSettings":
        """From the section of the configuration."""
        reality = section["reality"]
        return cls(
            effects=in_reality(section["effects"], reality),
            dials=REALITIES[reality].dials[section["learnable"]] if reality != NOMINAL else Dials(0.0, 0.0),
            mesh=section["mesh"],
            interfaces=section["interfaces"],
            fem=FemSettings(**section["fem"]),
        )


def resolve(effects: str | Mapping[str, Any]) -> dict[str, Any]:
    """Value of every effect of the config section `virtual.outcome.effects`, with :data:`NOMINAL` replaced."""
    wanted = dict.fromkeys(EFFECTS, NOMINAL) if effects == NOMINAL else effects
    return {name: effect.nominal if wanted[name] == NOMINAL else wanted[name] for name, effect in EFFECTS.items()}


def in_reality(effects: str | Mapping[str, Any], reality: str) -> dict[str, Any]:
    """The effects that a reality has: nominal, those of motion and noise of the scan alone, on the methods' own mesh;
    between scans of one modality the posture does not change."""
    values = resolve(effects)
    if reality == NOMINAL:
        kept = {name for name, effect in EFFECTS.items() if effect.kind in (MOTION, SCAN)} - {"expression"}
        return {name: value if name in kept else EFFECTS[name].nominal for name, value in values.items()}
    return values if REALITIES[reality].upright else values | {"posture": EFFECTS["posture"].nominal}
