"""A user's wish, read and checked: landmarks (3D Slicer markups), a surface (PLY, STL, VTP), a table of measures."""

import logging
import os
from collections.abc import Mapping, Sequence
from difflib import get_close_matches
from pathlib import Path

import numpy as np

from pinnochio.errors import InputError
from pinnochio.geometry.closest_points import closest_points
from pinnochio.importing.markups import ENDING, read_markups
from pinnochio.importing.segmentation import read_postop
from pinnochio.inverse.wish import Marks, PlaceWish, SurfaceWish, Wish, named
from pinnochio.model.landmarks import face_landmarks
from pinnochio.model.patient import PatientModel

SURFACES = (".ply", ".stl", ".vtp", ".obj")
FARTHEST = 30.0  # mm that a place of the face is wished away from where it is, at most [I: soft tissue follows by less]
OFF_FACE = 8.0  # mm between a marked point and the skin [I]
# Other frames and units that a wish may have come in by mistake.
MISTAKES = {
    "RAS instead of LPS, or the other way round": np.array([-1.0, -1, 1]),
    "metres": np.full(3, 1000.0),
    "centimetres": np.full(3, 10.0),
}
# Cephalometric signs of the landmarks [R].
SIGNS = {
    "sellion": "Se",
    "pronasale": "Prn",
    "subnasale": "Sn",
    "labrale_superius": "Ls",
    "stomion": "Sto",
    "labrale_inferius": "Li",
    "sublabiale": "Sl",
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
    known = named(face_landmarks(model))
    own = read_markups(markups, case).points
    for path in files:
        if str(path).lower().endswith(ENDING):
            wishes += _places(path, model, known, own, weights["landmark"], case)
        elif Path(path).suffix.lower() in SURFACES:
            wishes.append(_surface(path, model, weights["surface"], case))
        else:
            raise InputError(
                case, path, "it is no wish", f"give landmarks ({ENDING}) or a surface ({', '.join(SURFACES)})"
            )
    if not wishes:
        raise InputError(case, "wish", "nothing is wished", f"add wish{ENDING} or wish.ply")
    return wishes


def _places(path, model: PatientModel, known: Mapping, own: Mapping, weight: float, case: str) -> list[PlaceWish]:
    """One wish per point of a markups file."""

    def refuse(problem: str, remedy: str):
        raise InputError(case, path, problem, remedy)

    wished = read_markups([path], case).points
    if not wished:
        refuse("it holds no point", "place a point where each landmark shall be")
    signs = {sign.lower(): name for name, sign in SIGNS.items()} | {name: name for name in known}
    rest, targets = {}, {}
    for label, target in wished.items():
        name = label if label in own else signs.get(label.strip().lower().replace(" ", "_"))
        if name is None:
            near = get_close_matches(label.lower(), [*signs, *own], n=1, cutoff=0.5)
            meant = f"; did you mean {near[0]!r}?" if near else ""
            signs_named = ", ".join(f"{name} ({sign})" for name, sign in SIGNS.items())
            refuse(
                f"{label!r} is no landmark of the face{meant}",
                f"name one of {signs_named}, or mark {label!r} as it is now in another markups file of the patient",
            )
        if name in targets:
            refuse(f"{name!r} is wished to two places", "keep one point of it")
        start = own.get(name, known.get(name))
        away = closest_points(start[None], model.skin_points, model.skin_faces).distance[0]
        if away > OFF_FACE:
            refuse(f"{label!r} is marked {away:.1f} mm off the face as it is now", "mark it on the skin")
        rest[name], targets[name] = start, target
    places = np.array(list(targets.values()))
    _check_near(
        np.linalg.norm(places - np.array(list(rest.values())), axis=1),
        list(targets),
        refuse,
        lambda turn: np.linalg.norm(turn * places - np.array(list(rest.values())), axis=1),
    )
    marks = Marks.on(model, rest)
    return [PlaceWish(name, marks, index, targets[name], weight) for index, name in enumerate(marks.names)]


def _surface(path, model: PatientModel, weight: float, case: str) -> SurfaceWish:
    def refuse(problem: str, remedy: str):
        raise InputError(case, path, problem, remedy)

    skin = model.skin_points[model.judged_points]
    points, faces = read_postop(path, case, model.skin_points)

    def away(turn) -> np.ndarray:
        at = closest_points(skin, turn * points, faces)
        return at.distance[~at.border]

    now = away(np.ones(3))
    if not len(now):
        refuse("it lies nowhere over the face", "give the wished skin in the frame of the scan (LPS, mm)")
    _check_near(np.array([np.median(now)]), ["the surface"], refuse, lambda turn: np.array([np.median(away(turn))]))
    if len(now) < 0.5 * len(skin):
        logging.warning("case %r: %s lies over %.0f %% of the face", case, path, 100 * len(now) / len(skin))
    return SurfaceWish.of(Path(path).name, points, faces, weight)


def _check_near(away: np.ndarray, names: Sequence[str], refuse, turned) -> None:
    """Refuse what is farther than FARTHEST; turned(factors) gives the distances in another frame or unit."""
    if away.max() <= FARTHEST:
        return
    far = int(away.argmax())
    problem = f"{names[far]!r} is wished {away[far]:.0f} mm away from where it is"
    for mistake, factors in MISTAKES.items():
        other = turned(factors)
        if len(other) and np.nanmax(other) <= FARTHEST:
            refuse(f"{problem}; its coordinates seem to be in {mistake}", "save it in LPS (or RAS, said so) and mm")
    refuse(problem, f"wish it within {FARTHEST:.0f} mm, in the frame of the scan (LPS, mm)")
