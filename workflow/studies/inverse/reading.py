"""A user's wish, read and checked: landmarks (3D Slicer markups), a surface (PLY, STL, VTP), a table of measures."""

import logging
import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from pinnochio.errors import InputError, Refuse, refusal
from pinnochio.geometry.closest_points import closest_points
from pinnochio.importing.cohort import decimal, read_rows
from pinnochio.importing.markups import ENDING, POINTS, read_markups
from pinnochio.importing.segmentation import read_postop
from pinnochio.json_text import meant
from pinnochio.model.measures import MEASURES
from pinnochio.model.patient import PatientModel
from studies.inverse.wish import Marks, MeasureWish, PlaceWish, SurfaceWish, Wish

SURFACES = (".ply", ".stl", ".vtp", ".obj")
FARTHEST = 30.0  # mm that a place of the face is wished away from where it is, at most [I: soft tissue follows by less]
NEARLY_ALL = 90  # percent of what a wished surface lies over that FARTHEST holds of
FARTHEST_MEASURE = {"mm": 25.0, "degree": 60.0}  # change of a measure, at most [I]
LARGEST_WEIGHT = 1e6
COLUMNS = ("measure", "value", "change", "weight")
OFF_FACE = 8.0  # mm between a marked point and the skin [I]
# Other frames and units that a wish may have come in by mistake.
MISTAKES = {
    "RAS instead of LPS, or the other way round": np.array([-1.0, -1, 1]),
    "metres": np.full(3, 1000.0),
    "centimetres": np.full(3, 10.0),
}
# Cephalometric signs of the landmarks [R].
SIGNS = {
    "sellion": "N'",
    "pronasale": "Prn",
    "subnasale": "Sn",
    "labrale_superius": "Ls",
    "stomion": "Sto",
    "labrale_inferius": "Li",
    "sublabiale": "B'",
    "subspinale": "A'",
    "pogonion": "Pog'",
    "menton": "Me'",
    "alare_right": "AlR",
    "alare_left": "AlL",
    "cheilion_right": "ChR",
    "cheilion_left": "ChL",
}


def read_wish(
    files: Sequence[str | os.PathLike],
    model: PatientModel,
    weights: Mapping[str, float],
    case: str,
    markups: Sequence[str | os.PathLike] = (),
) -> Wish:
    """All wishes of the files. weights: of a `surface`, a `landmark`, a `measure`; markups: files with points of the
    face as it is, which a wish may name beside the landmarks that are found.

    InputError for what cannot be read, is not on the face, or lies so far off that frame or unit must be wrong.
    """
    wishes: list = []
    marks = Marks.of(model, read_markups(markups, case).points)
    for path in files:
        if str(path).lower().endswith((ENDING, POINTS)):
            wishes += _places(path, model, marks, weights["landmark"], case)
        elif Path(path).suffix.lower() in SURFACES:
            wishes.append(_surface(path, model, weights["surface"], case))
        else:
            wishes += _measures(path, model, marks, weights["measure"], case)
    if not wishes:
        raise InputError(case, "wish", "nothing is wished", f"add wish{ENDING}, wish.ply or wish.csv")
    names = [item.name for item in wishes]
    if twice := [name for name in names if names.count(name) > 1]:
        raise InputError(case, ", ".join(map(str, files)), f"{twice[0]!r} is wished twice", "keep one of them")
    return wishes


def _places(path, model: PatientModel, marks: Marks, weight: float, case: str) -> list[PlaceWish]:
    """One wish per point of a markups file."""
    refuse = refusal(case, path)
    wished = read_markups([path], case).points
    if not wished:
        refuse("it holds no point", "place a point where each landmark shall be")
    signs = {sign.lower(): name for name, sign in SIGNS.items()} | {name.lower(): name for name in marks.names}
    targets = {}
    for label, target in wished.items():
        name = signs.get(label.strip().lower().replace(" ", "_"))
        if name is None:
            known = ", ".join(f"{name} ({sign})" for name, sign in SIGNS.items() if name in marks.names)
            refuse(
                f"{label!r} is no landmark of the face{meant(label.lower(), [*signs])}",
                f"name one of {known}, or mark {label!r} as it is now in another markups file of the patient",
            )
        if name not in marks.names:
            refuse(f"{label!r} cannot be found on this face", "wish something else")
        if name in targets:
            refuse(f"{name!r} is wished to two places", "keep one point of it")
        targets[name] = target
    wished = marks.chosen(list(targets))
    away = closest_points(wished.rest, model.skin_points, model.skin_faces).distance
    if away.max() > OFF_FACE:
        refuse(
            f"{wished.names[away.argmax()]!r} is marked {away.max():.1f} mm off the face as it is now", "mark its skin"
        )
    places = np.array(list(targets.values()))
    _check_near(lambda turn: np.linalg.norm(turn * places - wished.rest, axis=1), wished.names, refuse)
    return [PlaceWish(name, wished.chosen([name]), target, weight) for name, target in targets.items()]


def _measures(path, model: PatientModel, marks: Marks, weight: float, case: str) -> list[MeasureWish]:
    """One wish per row of a table with the columns measure, and value or change, and weight if wanted."""
    refuse = refusal(case, path)
    columns, *rows = read_rows(path, refuse)
    if not rows or not set(columns) <= set(COLUMNS) or "measure" not in columns or len({*columns}) < len(columns):
        refuse(f"its columns are {columns or 'none'}", f"give columns {', '.join(COLUMNS)}, each once, and a row")
    known = {name.lower(): name for name in MEASURES} | {
        measure.title.lower(): name for name, measure in MEASURES.items()
    }
    wishes = []
    for row in rows:
        row = dict(zip(columns, row, strict=True))
        name = known.get(row["measure"].lower())
        if name is None:
            problem = f"{row['measure']!r} is no measure{meant(row['measure'].lower(), known, 0.4)}"
            refuse(problem, f"name one of {', '.join(MEASURES)}")
        numbers = {}
        for key in COLUMNS[1:]:
            if row.get(key):
                try:
                    numbers[key] = decimal(row[key])
                except ValueError:
                    numbers[key] = np.nan
                if not np.isfinite(numbers[key]):
                    refuse(f"{key} of {name!r} is {row[key]!r}", "write a number, without its unit")
        if ("value" in numbers) == ("change" in numbers):
            refuse(f"{name!r} has {'both' if 'value' in numbers else 'neither'} value and change", "give one of them")
        if not 0 < numbers.get("weight", 1) <= LARGEST_WEIGHT:
            remedy = f"give a weight above 0, of {LARGEST_WEIGHT:g} at most, or leave the row out"
            refuse(f"the weight of {name!r} is {numbers['weight']:g}", remedy)
        weight_of_row = numbers.pop("weight", weight)
        wishes.append(measure_wish(name, model, marks, weight_of_row, refuse, **numbers))
    return wishes


def measure_wish(
    name: str,
    model: PatientModel,
    marks: Marks,
    weight: float,
    refuse: Refuse,
    value: float | None = None,
    change: float | None = None,
) -> MeasureWish:
    """The wish that a measure be `value`, or be off by `change` from what it is; refused where the face has no such
    measure, or it lies beyond what an operation changes."""
    measure = MEASURES[name]
    now = np.nan
    if all(point in marks.names for point in measure.points):
        wish = MeasureWish(name, marks.chosen(measure.points), measure, 0.0, weight)
        now = wish.value(np.zeros_like(model.points))
    if not np.isfinite(now):
        refuse(f"{name!r} cannot be measured on this face", "wish something else")
    wish = replace(wish, target=now + change if value is None else value)
    if not abs(wish.target - now) <= FARTHEST_MEASURE[measure.unit]:
        problem = f"{name!r} is {now:.1f} {measure.unit} now and wished to be {wish.target:.1f}"
        refuse(problem, f"wish a change of {FARTHEST_MEASURE[measure.unit]:g} {measure.unit} or less")
    return wish


def _surface(path, model: PatientModel, weight: float, case: str) -> SurfaceWish:
    refuse = refusal(case, path)
    skin = model.skin_points[model.judged_points]
    points, faces = read_postop(path, case, model.skin_points)

    def away(turn) -> np.ndarray:
        at = closest_points(skin, turn * points, faces)
        # Not the median: walls of a face that lies far in front of its place are near the walls of this one.
        return np.percentile(at.distance[~at.border], [NEARLY_ALL]) if not at.border.all() else np.array([np.inf])

    _check_near(away, ["the surface"], refuse)
    wish = SurfaceWish.of(Path(path).name, model, points, faces, weight)
    share = np.isfinite(wish.distances(np.zeros_like(model.points))[model.judged_points]).mean()
    if share < 0.5:
        logging.warning("case %r: %s lies over %.0f %% of the face", case, path, 100 * share)
    return wish


def _check_near(away: Callable[[np.ndarray], np.ndarray], names: Sequence[str], refuse) -> None:
    """Refuse what lies farther than FARTHEST; away(factors) gives the distances (k,) with other coordinates."""
    now = away(np.ones(3))
    if now.max() <= FARTHEST:
        return
    far = int(now.argmax())
    problem = f"{names[far]!r} is wished {now[far]:.0f} mm away from where it is"
    if not np.isfinite(now[far]):
        problem = "it lies nowhere over the face"
    for mistake, factors in MISTAKES.items():
        if away(factors).max() <= FARTHEST:
            refuse(f"{problem}; its coordinates seem to be in {mistake}", "save it in LPS (or RAS, said so) and mm")
    refuse(problem, f"wish it within {FARTHEST:.0f} mm, in the frame of the scan (LPS, mm)")
