"""What a user must know of one prediction before believing it, as JSON holds it and in plain words."""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from pinnochio.mechanics.settings import FemSettings
from pinnochio.metrics.validity import boundary_metrics, equilibrium_of, volume_metrics
from pinnochio.model.patient import PatientModel
from pinnochio.model.regions import NAMES
from pinnochio.patients.in_distribution import Ranges, anatomy_quantities, plan_quantities
from pinnochio.plans.plan import Plan
from pinnochio.statistics.intervals import Calibration, Interval

RESEARCH = "For research only; not for planning or treating patients."
# Metrics that the certificate compares with those of the study's held-out patients.
USUAL = ("min_jacobian", "eqres_rel", "moving_error", "sliding_error")
# What is compared with the training.
PARTS = ("segments", "muscle", "anatomy", "plan")
WIDENED = 1.1  # half-width by the calibrated one from which it counts as widened


class Row(NamedTuple):
    """One line of the certificate in words; good: whether it is as it should be, None where nobody can say."""

    what: str
    value: str
    meaning: str
    good: bool | None = None


def measures(patient: PatientModel, plan: Plan, displacement: np.ndarray, fem: FemSettings) -> dict:
    """Elements, equilibrium, boundary and movement of a field (n, 3) mm; the names are those of cases.csv."""
    moved = np.linalg.norm(patient.moved_skin(displacement) - patient.skin_points, axis=1)[patient.judged_points]
    return {
        "nodes": len(patient.points),
        "elements": len(patient.cells),
        **volume_metrics(patient.points, patient.cells, patient.tissue, displacement),
        **equilibrium_of(patient, displacement, fem),
        **boundary_metrics(patient, plan, displacement),
        "skin_mean_mm": moved.mean(),
        "skin_max_mm": moved.max(),
    }


def interval_measures(interval: Interval, calibration: Calibration) -> dict:
    """The half-width over the judged face, and on how much of it the disagreement of the fold models widened it."""
    half_width = interval.half_width
    known = np.isfinite(half_width)
    calibrated = np.array([calibration.half_width[name] or np.nan for name in NAMES])
    return {
        "level": calibration.level,
        "patients": calibration.patients,
        "median_mm": np.median(half_width[known]),
        "largest_mm": half_width[known].max(),
        "widened_percent": 100 * np.mean(half_width[known] > WIDENED * calibrated[interval.region[known]]),
    }


def in_distribution(patient: PatientModel, plan: Plan, quality: Mapping, ranges: Ranges) -> dict:
    """Whether each of PARTS is in the distribution of the training (`within`), all of them are, and by which numbers.

    quality: the patient's quality report.
    """
    parts = {
        "segments": {
            "value": list(patient.segments),
            "trained": list(ranges.segments),
            "within": set(patient.segments) <= set(ranges.segments),
        },
        "muscle": {
            "value": patient.muscle,
            "trained": list(ranges.muscle),
            "within": patient.muscle in ranges.muscle,
        },
        "anatomy": ranges.anatomy.compare(anatomy_quantities(patient, quality)),
        "plan": ranges.plan.compare(plan_quantities(patient, plan)),
    }
    return {"within": all(part["within"] for part in parts.values())} | parts


def plain(value):
    """The value as JSON holds it: plain numbers, None for what is not finite."""
    if isinstance(value, Mapping):
        return {key: plain(own) for key, own in value.items()}
    if isinstance(value, list | tuple):
        return [plain(own) for own in value]
    if isinstance(value, float | np.floating):
        return round(float(value), 9) if np.isfinite(value) else None
    return value.item() if isinstance(value, np.generic) else value


def in_words(certificate: Mapping) -> list[Row]:
    """The certificate as a table that needs no other explanation."""
    rows = _field_rows(certificate["measures"], certificate["models"])
    if not certificate["models"]:
        none = Row("Interval", "none", "No interval is calibrated for this method.")
        return [*rows, none, Row("In distribution", "not asked", "The method has not been trained on anybody.")]
    return [
        *rows,
        _interval_row(certificate["interval"], certificate["in_distribution"]["within"]),
        *_distribution_rows(certificate["in_distribution"], certificate["models"]["cohort"]),
    ]


def _field_rows(of: Mapping, models: Mapping | None) -> list[Row]:
    def usual(name: str, digits: str) -> str:
        """What held-out patients of the study had, where that is known."""
        if not models or name not in models["usual"]:
            return ""
        low, middle, high = (format(value, digits) for value in models["usual"][name])
        return f" On held-out patients of the {models['cohort']}: {low} to {high}, median {middle}."

    def millimetres(name: str) -> str:
        return "no such tissue" if of[name] is None else f"{of[name]:.3f} mm"

    folded = "The field folds tissue over; do not use it there." if of["inverted"] else "No piece of tissue is folded."
    force = "Force that is not in balance over the reaction of the bones; converged finite elements: below 1e-6."
    moving = "Mean distance of the tissue attached to bone from where the plan takes it."
    sliding = "Mean gap or penetration of the tissue that slides along bone."
    moved = f"{of['skin_mean_mm']:.1f} mm mean, {of['skin_max_mm']:.1f} mm at most"
    return [
        Row("Elements turned inside out", f"{of['inverted']} of {of['elements']}", folded, of["inverted"] == 0),
        Row(
            "Smallest volume ratio (min J)",
            f"{of['min_jacobian']:.3f}",
            "1 keeps its volume, 0 is flat." + usual("min_jacobian", ".2f"),
            of["min_jacobian"] > 0,
        ),
        Row("Residual", f"{of['eqres_rel']:.2g}", force + usual("eqres_rel", ".2g")),
        Row("Boundary mismatch, moving", millimetres("moving_error"), moving + usual("moving_error", ".2f")),
        Row("Boundary mismatch, sliding", millimetres("sliding_error"), sliding + usual("sliding_error", ".2f")),
        Row("Movement of the skin", moved, "Over the judged face."),
    ]


def _interval_row(interval: Mapping, within: bool) -> Row:
    meaning = f"{100 * interval['level']:g} % of a region's points should lie this near to the outcome, as they did on "
    meaning += f"{interval['patients']} held-out patients, if patient and plan are like theirs. "
    meaning += "" if within else "They are not: do not rely on it. "
    meaning += f"Widened on {interval['widened_percent']:.0f} % of the face, where the fold models disagree."
    return Row("Interval", f"± {interval['median_mm']:.1f} mm median, {interval['largest_mm']:.1f} mm at most", meaning)


def _distribution_rows(compared: Mapping, cohort: str) -> list[Row]:
    rows = []
    for name, title in (("segments", "Bone segments"), ("muscle", "Muscle layer")):
        value, trained = (compared[name][key] for key in ("value", "trained"))
        value = value if isinstance(value, str) else ", ".join(value)
        rows.append(Row(title, value, f"In training: {', '.join(trained)}.", compared[name]["within"]))
    for name, title in (("anatomy", "Anatomy"), ("plan", "Plan")):
        part = compared[name]
        outside, quantities = part["outside"], part["quantities"]
        meaning = f"{len(outside)} of {len(quantities)} quantities lie outside the range of the {part['patients']} "
        meaning += f"patients of the {cohort}."
        if outside:
            own = quantities[outside[0]]
            meaning += f" Farthest: {outside[0]} is {own['value']:.1f}, there {own['low']:.1f} to {own['high']:.1f}"
            meaning += f", so {own['excess']:.2f} widths of that range beyond it. Up to {part['threshold']:.2f} is "
            meaning += f"usual: some {100 * part['false_alarm']:.0f} of 100 such patients have more."
        if part["incomparable"]:
            meaning += f" {len(part['incomparable'])} have no counterpart in the training, or could not be measured."
        rows.append(Row(title, f"{'like' if part['within'] else 'unlike'} the training's", meaning, part["within"]))
    return rows
