"""What a user must know of one prediction before believing it, as JSON holds it and in plain words."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from pinnochio.mechanics.held_lips import CLOSING, CROSSED, OPEN, SEALED, held_lips
from pinnochio.mechanics.settings import FemSettings
from pinnochio.metrics.model_quality import DETAIL, off_mesh
from pinnochio.metrics.validity import (
    EDGE,
    OFF_BONE,
    beside_edge,
    boundary_metrics,
    equilibrium_of,
    off_bone,
    volume_metrics,
)
from pinnochio.metrics.worst_point import FLAGGED
from pinnochio.model.patient import PatientModel
from pinnochio.patients.in_distribution import Ranges, anatomy_quantities, out_of_range, plan_quantities
from pinnochio.plans.plan import Plan
from pinnochio.plans.roles import GUESS
from pinnochio.statistics.intervals import Calibration, Interval

RESEARCH = "For research only; not for planning or treating patients."
# Metrics that the certificate compares with those of the study's held-out patients.
USUAL = ("min_jacobian", "eqres_rel", "moving_error", "sliding_error")
# What is compared with the training.
PARTS = ("segments", "muscle", "anatomy", "plan")
WIDENED = 1.1  # half-width by the calibrated one from which it counts as widened
# What is called usable, to be used with care, and not usable [I].
USABLE, CARE, NOT_USABLE = "usable", "with care", "not usable"
FLAT = 0.1  # least volume ratio below which care is due where nothing usual is known
MISMATCH = 0.5, 2.0  # mm between tissue and bone from which care is due, and from which nothing is usable
RESIDUALS = 10.0  # times the largest usual residual from which nothing is usable
EDGES = 15.0  # % of the face beside the edge of the scan from which care is due; of the virtual patients 6 to 9 [X]
REPAIRED = 0.01  # share of the elements above which the repair is no small matter
# mm and degrees of a bone beyond which trials of the mechanics begin to fail [X: docs/lab/stability.md].
SWEPT = 10.0, 15.0
FAR = 1.0  # widths of the training's range beyond what is usual from which nothing is usable
# What to do about a line that speaks against the prediction.
SOLVE = "Predict with finite elements (predict.method: fem_sliding), or plan a smaller movement"
SOLVED = "Plan a smaller movement, or take another mesh (mesh.nodes)"
UNLIKE = "Hold the face against finite elements (predict.method: fem_sliding)"
ADVICE = {
    "Bones unlike people's": "Look at segments.png, and correct labels or cuts",
    "Solver": SOLVED,
    **dict.fromkeys(("Corrections", "Inversion repair", "Elements turned inside out", "Smallest volume ratio (min J)",
                     "Residual", "Boundary mismatch, moving", "Boundary mismatch, sliding"), SOLVE),
    "Tissue off its bone": "Plan a smaller movement; nobody knows what holds the tissue there",
    "Motion of the bones": "Hold the face against one after a smaller movement",
    "Farthest from linear elasticity": "Look at that place before believing it",
    "Edge of the scan": "Take a scan that shows more about the face",
    "Lips that cross": "Read nothing off the lips; they are shown in contact",
    "Lips apart": "Expect lips that do not close without strain; plan bones that part them less",
    "Detail of the skin": "For nose and lips take finite elements on a mesh of 20,000 nodes: about 2 s a plan",
    **dict.fromkeys(("Bone segments", "Muscle layer", "Anatomy", "Plan"), UNLIKE),
}  # fmt: skip


class Finding(NamedTuple):
    """One line of the certificate in words; good: whether it is as it should be, None where nobody can say; bad:
    whether the prediction is not usable for it."""

    what: str
    value: str
    meaning: str
    good: bool | None = None
    bad: bool = False


class CertificateGrade(NamedTuple):
    """What the certificate comes to: USABLE, CARE or NOT_USABLE, and the reasons."""

    grade: str
    reasons: tuple[str, ...]


def measures(
    patient: PatientModel, plan: Plan, displacement: np.ndarray, fem: FemSettings, forces: np.ndarray | None = None
) -> dict:
    """Elements, equilibrium, boundary and movement of a field (n, 3) mm; the names are those of cases.csv.

    forces (n, 3) mN: the load that the field declares.
    """
    moved = np.linalg.norm(patient.moved_skin(displacement) - patient.skin_points, axis=1)[patient.judged_points]
    lips = held_lips(patient, displacement)
    return {
        "nodes": len(patient.points),
        "elements": len(patient.cells),
        **volume_metrics(patient.points, patient.cells, patient.tissue, displacement),
        **equilibrium_of(patient, displacement, fem, forces),
        **boundary_metrics(patient, plan, displacement),
        **largest_motions(patient, plan),
        "off_bone_mm": astray(patient, plan, displacement),
        **beside_edge(patient, moved),
        **off_mesh(patient),
        "lips_cross_mm": lips.crossed,
        **{f"lips_{name}_mm": getattr(lips, name) for name in ("before", "parted", "left")},
        "skin_mean_mm": moved.mean(),
        "skin_max_mm": moved.max(),
    }


def largest_motions(patient: PatientModel, plan: Plan) -> dict[str, float]:
    """How far the middle of any bone moves, mm, and how far any turns, degrees, at most."""
    moved, angles = patient.bone_displacement(plan), [plan.motion(name).angle for name in patient.segments]
    ways = [np.linalg.norm(moved[patient.bone_segment == index].mean(axis=0)) for index in range(len(angles))]
    return {"motion_mm": max(ways, default=0.0), "turn_degrees": max(angles, default=0.0)}


def astray(patient: PatientModel, plan: Plan, displacement) -> float:
    """How far tissue, sliding (:func:`off_bone`) or attached, is from its bone at most, mm."""
    cue, held = patient.reference_cue(plan)
    attached = np.linalg.norm(displacement - cue, axis=1)[held]
    return max(float(part.max(initial=0.0)) for part in (off_bone(patient, plan, displacement), attached))


def interval_measures(interval: Interval, calibration: Calibration, widening: float = 1.0) -> dict:
    """The half-width over the judged face, and on how much of it the disagreement of the fold models widened it.

    widening: factor on all of it, of a patient or plan beyond the training.
    """
    half_width = interval.half_width
    known = np.isfinite(half_width)
    return {
        "level": calibration.level,
        "patients": calibration.patients,
        "median_mm": np.median(half_width[known]),
        "largest_mm": half_width[known].max(),
        "widening": widening,
        "widened_percent": 100
        * np.mean(half_width[known] > WIDENED * widening * calibration.by_region[interval.region[known]]),
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
        "muscle": {"value": patient.muscle, "trained": list(ranges.muscle), "within": patient.muscle in ranges.muscle},
        "anatomy": ranges.anatomy.compare(anatomy_quantities(patient, quality)),
        "plan": ranges.plan.compare(plan_quantities(patient, plan)),
    }
    return {"within": all(part["within"] for part in parts.values())} | parts


def plain(value):
    """The value as JSON holds it: plain numbers, None for what is not finite."""
    if isinstance(value, Mapping):
        return {key: plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    if isinstance(value, float | np.floating):
        return round(float(value), 9) if np.isfinite(value) else None
    return value.item() if isinstance(value, np.generic) else value


def in_words(certificate: Mapping) -> list[Finding]:
    """The certificate as a table that needs no other explanation."""
    rows = [
        *import_rows(certificate.get("import", {})),
        *_solution_rows(certificate["solution"], certificate["measures"]),
        *_field_rows(certificate["measures"], certificate["models"]),
    ]
    if not certificate["models"]:
        none = Finding("Interval", "none", "No interval is calibrated for this method.")
        return [*rows, none, Finding("In distribution", "not asked", "The method has not been trained on anybody.")]
    return [
        *rows,
        _interval_row(certificate["interval"], certificate["in_distribution"]),
        *_distribution_rows(
            certificate["in_distribution"], certificate["models"]["cohort"], "instead_of" not in certificate
        ),
    ]


def verdict(certificate: Mapping) -> CertificateGrade:
    """What all rows of a certificate come to, and what to do about those that speak against using the prediction."""
    rows, advice = in_words(certificate), ADVICE
    if certificate["solution"]["solver"]:  # finite elements have predicted it
        advice = {what: SOLVED if words == SOLVE else words for what, words in ADVICE.items()}
    for grade, chosen in ((NOT_USABLE, [row for row in rows if row.bad]), (CARE, [o for o in rows if o.good is False])):
        if chosen:
            return CertificateGrade(grade, tuple(f"{advice[row.what]} ({row.what}: {row.value})" for row in chosen))
    return CertificateGrade(USABLE, ())


def of_import(quality: Mapping, warnings: Sequence[str] = ()) -> dict[str, list[str]]:
    """What a patient's quality report says of the import: warnings (and those of a plan), what needs care, and the cuts
    that nobody has placed."""
    return {
        "warnings": [*quality["warnings"], *warnings],
        "care": list(quality["care"]),
        "guessed": [name for name, why in dict(quality["cuts"]).items() if why.endswith(GUESS)],
    }


def import_rows(imported: Mapping) -> list[Finding]:
    """What an import says, as lines of the certificate."""
    rows = []
    if guessed := imported.get("guessed"):
        meaning = "Nobody has said where the surgeon cuts: it was guessed from the bone. Look at segments.png."
        rows.append(Finding("Cuts by rule", ", ".join(guessed), meaning))
    for words in imported.get("care", ()):
        rows.append(
            Finding("Bones unlike people's", words, "Look at segments.png: are the labels and cuts right?", False)
        )
    return rows


def _solution_rows(solution: Mapping, of: Mapping) -> list[Finding]:
    rows = []
    if solution["solver"]:
        value = f"converged in {solution['iterations']} iterations"
        meaning = "Forces are in balance under the whole plan."
        if not solution["converged"]:
            value = f"stopped at {100 * solution['load']:.0f} % of the plan"
            meaning = f"{solution['reason'].capitalize()}. What is shown is the last state before that, not the plan's."
        whole = solution["converged"] and solution["load"] >= 1
        rows.append(Finding("Solver", value, meaning, whole, not whole))
        return rows
    if not solution["converged"]:
        rows.append(Finding("Corrections", "not converged", "Newton's corrections of a model stopped early.", False))
    if solution["damping"] < 1:
        meaning = "The models' field turned tissue inside out, so it was made smaller: the plan is not carried out."
        value = f"field scaled to {100 * solution['damping']:.2g} %"
        rows.append(Finding("Inversion repair", value, meaning, False, True))
    elif solution["repaired"]:
        meaning = "Elements that the models' fields had turned inside out or flattened, and that were solved again."
        good = None if solution["repaired"] <= REPAIRED * of["elements"] else False
        rows.append(Finding("Inversion repair", f"{solution['repaired']} of {of['elements']} elements", meaning, good))
    return rows


@dataclass(frozen=True)
class _Measured:
    """The measures of one prediction beside what the models' held-out patients had, where that is known."""

    of: Mapping
    models: Mapping | None

    def usual(self, name: str, digits: str) -> str:
        """What held-out patients of the study had, where that is known."""
        if not self.models or name not in self.models["usual"]:
            return ""
        low, middle, high = (format(value, digits) for value in self.models["usual"][name])
        return f" On held-out patients of the {self.models['cohort']}: {low} to {high}, median {middle}."

    def worse(self, name: str, than: float | None = None) -> bool | None:
        """False where a value is worse than on any held-out patient, else than a bound; True where it is not."""
        value, least = self.of[name], name == "min_jacobian"
        if value is None:
            return None
        if self.models and name in self.models["usual"]:
            than = self.models["usual"][name][0 if least else 2]
        if than is None:
            return None
        return bool(value >= than if least else value <= than)

    def number(self, name: str, digits: str) -> str:
        return "not a number" if self.of[name] is None else format(self.of[name], digits)

    def mismatch(self, kind: str, meaning: str) -> Finding:
        """The finding of tissue that lies off where its bone takes it; bad where that is so far, beyond what is usual,
        that the plan is not carried out."""
        name = f"{kind}_error"
        value = self.of[name]
        return Finding(
            f"Boundary mismatch, {kind}",
            "no such tissue" if value is None else f"{value:.3f} mm",
            meaning + self.usual(name, ".2f"),
            self.worse(name, MISMATCH[0]),
            value is not None and value > MISMATCH[1] and self.worse(name, MISMATCH[1]) is False,
        )


def _field_rows(of: Mapping, models: Mapping | None) -> list[Finding]:
    measured = _Measured(of, models)
    known = {name: np.nan if value is None else value for name, value in of.items()}
    largest = models["usual"].get("eqres_rel", [np.inf])[-1] if models else np.inf
    strained = not known["eqres_rel"] <= RESIDUALS * largest
    inverted = known["inverted"] != 0
    folded = "The field folds tissue over; do not use it there." if of["inverted"] else "No piece of tissue is folded."
    force = "Force that is not in balance over the reaction of the bones; converged finite elements: below 1e-6."
    moved = f"{of['skin_mean_mm']:.1f} mm mean, {of['skin_max_mm']:.1f} mm at most"
    return [
        Finding("Elements turned inside out", f"{of['inverted']} of {of['elements']}", folded, not inverted, inverted),
        Finding(
            "Smallest volume ratio (min J)",
            measured.number("min_jacobian", ".3f"),
            "1 keeps its volume, 0 is flat." + measured.usual("min_jacobian", ".2f"),
            known["min_jacobian"] > 0 and measured.worse("min_jacobian", FLAT),
            not known["min_jacobian"] > 0,
        ),
        Finding(
            "Residual",
            measured.number("eqres_rel", ".2g"),
            force + measured.usual("eqres_rel", ".2g"),
            measured.worse("eqres_rel"),
            strained,
        ),
        measured.mismatch("moving", "Mean distance of the tissue attached to bone from where the plan takes it."),
        measured.mismatch("sliding", "Mean gap or penetration of the tissue that slides along bone."),
        Finding(
            "Tissue off its bone",
            f"{measured.number('off_bone_mm', '.1f')} mm at most",
            f"What slides or is attached. Above {OFF_BONE:g} mm, beyond a rim or torn, nobody knows what holds it.",
            known["off_bone_mm"] <= OFF_BONE,
            not known["off_bone_mm"] <= OFF_BONE,
        ),
        Finding(
            "Motion of the bones",
            f"{of['motion_mm']:.1f} mm, {of['turn_degrees']:.0f} degrees at most",
            "Up to 8 mm and 12 degrees of one bone nearly all trials of the mechanics came out right, at 12 mm four of "
            "five; the others were called not usable.",
            known["motion_mm"] <= SWEPT[0] and known["turn_degrees"] <= SWEPT[1],
        ),
        Finding("Movement of the skin", moved, "Over the judged face."),
        *([_apart_row(of)] if "apart_mm" in of else []),
        Finding(
            "Edge of the scan",
            f"{of['edge_percent']:.0f} % of the face beside it, moves {of['edge_moved_mm']:.1f} mm at most",
            f"Within {EDGE:g} mm of where the scan ends. What lies beyond is not in the model, so that the prediction "
            "is worth less there.",
            of["edge_percent"] <= EDGES,
        ),
        Finding(
            "Lips that cross",
            f"{measured.number('lips_cross_mm', '.1f')} mm at most",
            f"Beyond what they did before. From {CROSSED:g} mm on the field is wrong there; they are shown in contact.",
            known["lips_cross_mm"] < CROSSED,
        ),
        *([_lips_row(of)] if "lips_left_mm" in of else []),
        _detail_row(of),
    ]


def _lips_row(of: Mapping) -> Finding:
    """How far the lips' edges lie apart, and why."""
    before, left = of["lips_before_mm"], of["lips_left_mm"]
    why = f"Closed before surgery, so shown closed, by {CLOSING:g} mm at most. The interlabial gap is of lips at rest."
    if before > SEALED:
        why = f"They were {before:.1f} mm apart before surgery, and are not closed."
    elif left > OPEN:
        why = f"Closed before surgery; the plan parts them by more than the {CLOSING:g} mm that they are shown closed."
    value = f"{left:.1f} mm as shown, {of['lips_parted_mm']:.1f} at rest, at most"
    return Finding("Lips apart", value, why, None if before > SEALED else left <= OPEN)


def _apart_row(of: Mapping) -> Finding:
    apart = of["apart_mm"]
    return Finding(
        "Farthest from linear elasticity",
        "not a number" if apart is None else f"{apart:.1f} mm at a point of the skin",
        f"Linear elasticity predicts the same plan. Above {FLAGGED:g} mm look at the place before believing it.",
        apart is not None and apart <= FLAGGED,
    )


def _detail_row(of: Mapping) -> Finding:
    value = f"{of['off_mesh_p95_mm']:.1f} mm off the mesh at 95 %"
    regions = [f"{name.replace('_', ' ')} {beyond:.1f}" for name, beyond in of["off_mesh_regions_mm"].items()]
    if regions:
        value += f" ({', '.join(regions)})"
    meaning = (
        f"How far the skin that is shown lies from the mesh that carries it; {of['off_mesh_mean_mm']:.1f} mm in the "
    )
    meaning += "mean. Form that is finer than the mesh rides on the tissue beneath: it is shown, not computed. Finite "
    meaning += "elements on a finer mesh (mesh.nodes) compute more of it."
    return Finding("Detail of the skin", value, meaning, of["off_mesh_p95_mm"] <= DETAIL)


def _interval_row(interval: Mapping, compared: Mapping) -> Finding:
    meaning = f"{100 * interval['level']:g} % of a region's points should lie this near to the outcome, as they did on "
    meaning += f"{interval['patients']} held-out patients, if patient and plan are like theirs. "
    if interval["widening"] > 1:
        meaning += f"They lie beyond: it is {interval['widening']:.1f} times as wide as calibrated. "
    meaning += "They are unlike what was measured: do not rely on it. " if out_of_range(compared) else ""
    meaning += f"Widened on {interval['widened_percent']:.0f} % of the face, where the fold models disagree."
    return Finding(
        "Interval", f"± {interval['median_mm']:.1f} mm median, {interval['largest_mm']:.1f} mm at most", meaning
    )


def _distribution_rows(compared: Mapping, cohort: str, learned: bool) -> list[Finding]:
    """learned: whether it matters, as what is shown was learned from the training."""
    rows = []
    for name, title in (("segments", "Bone segments"), ("muscle", "Muscle layer")):
        value, trained = (compared[name][key] for key in ("value", "trained"))
        value = value if isinstance(value, str) else ", ".join(value)
        rows.append(
            Finding(title, value, f"In training: {', '.join(trained)}.", compared[name]["within"] if learned else None)
        )
    for name, title in (("anatomy", "Anatomy"), ("plan", "Plan")):
        part = compared[name]
        outside, quantities = part["outside"], part["quantities"]
        meaning = f"{len(outside)} of {len(quantities)} quantities lie outside the range of the {part['patients']} "
        meaning += f"patients of the {cohort}."
        if outside:
            far = quantities[outside[0]]
            meaning += f" Farthest: {outside[0]} is {far['value']:.1f}, there {far['low']:.1f} to {far['high']:.1f}"
            meaning += f", so {far['excess']:.2f} widths of that range beyond it. Up to {part['threshold']:.2f} is "
            meaning += f"usual: some {100 * part['false_alarm']:.0f} of 100 such patients have more."
        if part["incomparable"]:
            meaning += f" {len(part['incomparable'])} have no counterpart in the training, or could not be measured."
        far = part["farthest"] - part["threshold"] > FAR
        value = "like the training's" if part["within"] else "beyond the training's"
        value = "far beyond the training's" if far else value
        rows.append(Finding(title, value, meaning, part["within"], far) if learned else Finding(title, value, meaning))
    return rows
