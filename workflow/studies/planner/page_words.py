"""What the page of the planner says of forecasts, plans and fits."""

from collections.abc import Mapping

import numpy as np

from pinnochio.mechanics.held_lips import CLOSING, CROSSED, OPEN
from pinnochio.metrics.validity import OFF_BONE
from pinnochio.model.measures import MEASURES
from pinnochio.patients.certificate import FAR, import_rows
from pinnochio.patients.face_measures import FaceMeasures, in_numbers
from pinnochio.plans.surgery import amount, segment_in_words
from pinnochio.statistics.intervals import Calibration
from studies.planner.forecast import Forecast
from studies.planner.jaws import FOSSA, LIMIT, Jaws, named
from studies.planner.wishing import Fit

FIRST_LOOK = "first look"
TAKE_OVER = "Finite elements take over where this plan is predicted."
WIDER = "Beyond the training in {}: the interval is wider for it."
OUTSIDE = f"Unlike the training in {{}}: do not rely on the interval. {TAKE_OVER}"
DAMPED = "Not usable: the field turned tissue inside out and was scaled to {:.2g} %; the plan is not carried out."
OFF = f"Not usable: tissue is {{:.1f}} mm off its bone. {TAKE_OVER}"
FAR_BEYOND = "Not usable: {:.1f} widths of the training's range beyond it."
REPAIR = "{} elements were turned inside out and solved again."
# Of bones that run into each other by less than LIMIT, and by more.
USUAL = {
    "cut": "Bones overlap where they are cut, as surgeons trim it (up to {:g} mm)",
    "removed": "Skull that is removed above the upper jaw (up to {:g} mm)",
    "teeth": "Teeth touch (up to {:g} mm)",
    "bone": "Bones touch (up to {:g} mm)",
}
COLLIDE = {
    "cut": "Bones overlap where they are cut by more than the {:g} mm that are trimmed as a rule (red points)",
    "removed": "The upper jaw runs more than {:g} mm into the skull (red points)",
    "teeth": "Teeth run through teeth by more than {:g} mm (red points)",
    "bone": "Bones run into each other by more than {:g} mm (red points)",
}
LUXATED = "A condyle is more than {:g} mm out of its place: {}."
PRACTICE = "Beyond what is practised: {}."
CROSS = "Lips would cross by {:.1f} mm; shown in contact."
APART = f"Lips stay {{:.1f}} mm apart, more than the {CLOSING:g} mm by which they are closed."
STILL = "Nothing is moved, so nothing changes."


def about(forecast: Forecast, deep: Mapping[tuple[str, str], float], jaws: Jaws, level: float) -> dict[str, str]:
    """A forecast in words; deep (mm): how deep pairs of bones run into each other; level: of the interval."""
    half_width = forecast.interval.half_width
    size = f"± {np.nanmedian(half_width):.2f} mm median, {np.nanmax(half_width):.2f} mm at most"
    words = f"{100 * level:g} % interval {size}; "
    words += FIRST_LOOK if forecast.least is None else f"smallest volume ratio {forecast.least:.2f}"
    usual, marks = overlaps(deep, jaws)
    if luxated := jaws.luxated(forecast.plan):
        marks.append(LUXATED.format(FOSSA, named({(name,): off for name, off in luxated.items()})))
    if far := jaws.beyond(forecast.plan):
        said = (f"{segment_in_words(name)} {word(part, name)}" for name, parts in far.items() for part in parts)
        marks.append(PRACTICE.format(", ".join(said)))
    moved = f"face moves {forecast.mean:.2f} mm in the mean, {forecast.most:.2f} mm at most"
    return {
        "moved": f"{moved}. {STILL}" if forecast.plan.still else moved,
        "more": f"{words}; after {forecast.seconds:.2f} s",
        "overlaps": " ".join(usual),
        "outside": warning(forecast),
        "marks": " ".join(marks),
    }


def overlaps(deep: Mapping[tuple[str, str], float], jaws: Jaws) -> tuple[list[str], list[str]]:
    """A sentence of each kind of overlap: of those that any plan has, and of those beyond LIMIT."""
    said = []
    for words, beyond in ((USUAL, False), (COLLIDE, True)):
        kinds = {kind: {pair: depth for pair, depth in deep.items()
                        if jaws.kind(*pair) == kind and (depth > LIMIT[kind]) == beyond} for kind in words}  # fmt: skip
        said.append([f"{words[kind].format(LIMIT[kind])}: {named(pairs)}." for kind, pairs in kinds.items() if pairs])
    return said[0], said[1]


def import_in_words(imported: Mapping) -> str:
    """What the import says that whoever plans must know: guessed cuts, bones unlike people's; empty for nothing."""
    return " ".join(f"{row.what}: {row.value}. {row.meaning}" for row in import_rows(imported))


def rows(forecast: Forecast, face: FaceMeasures, calibration: Calibration) -> dict[str, list[dict] | str]:
    """The measures of a forecast, the displacements of landmarks and the measures of bone, as the tables show them; the
    tracing as SVG."""
    known, moved = () if forecast.plan.still else (forecast.interval, calibration), forecast.interval.displacement
    measures, landmarks, bone = in_numbers(face.rows(moved, *known) + face.bone_rows(forecast.plan))
    tracing = face.tracing(forecast.plan, moved)
    return {"measures": measures, "landmarks": landmarks, "bone": bone, "tracing": tracing}


def fitted(fit: Fit) -> str:
    """How near the plan that is sought comes to the wish, in words."""
    by = "Finite elements" if fit.verified else "Proposal by the elastic map, which finite elements now verify"
    off = [f"{MEASURES[name].title} by {error:.1f}" for name, error in fit.missed.items() if not error <= fit.met]
    return f"{by}: " + (f"missed are {', '.join(off)} (mm or degrees)." if off else "every wish is met.")


def label(name: str, segment: str) -> str:
    """What a slider moves, and which way its positive end is."""
    part = amount(name, segment)
    title, less = (f"{name}: ", part.less.split()[-1]) if part.unit == "°" else ("", part.less)
    return f"{title}{part.more} (+) / {less} (−), {part.unit}"


def word(name: str, segment: str) -> str:
    """A part of a segment's motion in words."""
    part = amount(name, segment)
    return name if part.unit == "°" else f"{part.more} / {part.less}"


def warning(forecast: Forecast) -> str:
    """What speaks against a forecast, in words; empty where nothing does."""
    said = []
    if forecast.damping < 1:
        said.append(DAMPED.format(100 * forecast.damping))
    elif forecast.repaired:
        said.append(REPAIR.format(forecast.repaired))
    if not forecast.off_bone <= OFF_BONE:
        said.append(OFF.format(forecast.off_bone))
    if forecast.crossed >= CROSSED:
        said.append(CROSS.format(forecast.crossed))
    if forecast.apart > OPEN:
        said.append(APART.format(forecast.apart))
    if forecast.beyond > FAR:
        said.append(FAR_BEYOND.format(forecast.beyond))
    if forecast.out_of_distribution:
        words = OUTSIDE if forecast.out_of_range else WIDER
        said.append(words.format(", ".join(forecast.out_of_distribution)))
    return " ".join(said)
