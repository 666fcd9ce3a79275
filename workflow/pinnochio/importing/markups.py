"""Markups of 3D Slicer (`.mrk.json`, lists of points also `.fcsv`): points by label, planes by name, regions."""

import csv
import os
import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from pinnochio.errors import InputError, refusal
from pinnochio.geometry.plane import Plane
from pinnochio.json_text import numbers, read_json, read_text

ENDING, POINTS = ".mrk.json", ".fcsv"
FRAMES = {"LPS": np.ones(3), "0": np.array([-1.0, -1.0, 1.0]), "RAS": np.array([-1.0, -1.0, 1.0]), "1": np.ones(3)}
FARTHEST = 1e5  # mm from the origin of a scanner
PLANE, REGION, LIST = "Plane", "ROI", "Fiducial"
UNNAMED = re.compile(r"\w{0,2}[-_ ]?\d+")


@dataclass(frozen=True)
class Markups:
    """points: place (3,) mm by label; planes by name; regions: low and high corner (3,) mm of boxes; all LPS."""

    points: dict[str, np.ndarray] = field(default_factory=dict)
    planes: dict[str, Plane] = field(default_factory=dict)
    regions: list[tuple[np.ndarray, np.ndarray]] = field(default_factory=list)


def read_markups(paths: Sequence[str | os.PathLike], case: str) -> Markups:
    """All markups of the files. A turned region counts as the box along the axes that holds it.

    Points that bear a number of 3D Slicer (F-1), or lie on a curve, are marks of nothing. Raises InputError for what
    cannot be read, a unit other than mm and two points or planes of one name.
    """
    markups = Markups()
    for path in paths:
        refuse = refusal(case, path)
        try:
            older = str(path).lower().endswith(POINTS)
            content = _of_points(read_text(path, refuse)) if older else read_json(path, refuse)
            for markup in content["markups"]:
                units = markup.get("coordinateUnits", "mm")
                if (units[:1] if isinstance(units, list) else [units]) != ["mm"]:
                    refuse(f"its unit is {units!r}", "save the markups in millimetres")
                if str(markup.get("coordinateSystem", "LPS")) not in FRAMES:
                    refuse(f"its frame is {markup['coordinateSystem']!r}", "save the markups in LPS or RAS")
                turn = FRAMES[str(markup.get("coordinateSystem", "LPS"))]
                defined = [
                    point
                    for point in markup.get("controlPoints", ())
                    if point.get("positionStatus", "defined") == "defined"
                ]
                places = [turn * _three(point["position"]) for point in defined]
                if markup["type"] == PLANE:
                    # 3D Slicer writes no name but the file's; its points are called as the plane first was.
                    name = str(markup.get("name") or Path(path).name[: -len(ENDING)])
                    _add(markups.planes, name, _plane(markup, places, turn), refuse)
                elif markup["type"] == REGION:
                    if markup.get("insideOut"):
                        refuse("its region keeps what lies outside (insideOut)", "draw a region round what is kept")
                    markups.regions.append(_region(markup, turn))
                else:
                    for point, place in zip(defined, places, strict=True):
                        name = str(point["label"])
                        if name not in markups.points or markup["type"] == LIST and not UNNAMED.fullmatch(name):
                            _add(markups.points, name, place, refuse)
        except (OSError, ValueError, KeyError, TypeError, IndexError, AttributeError) as error:
            if isinstance(error, InputError):
                raise
            refuse(f"it cannot be read as markups ({error!r})", "save them again from 3D Slicer as .mrk.json")
    return markups


def _of_points(text: str) -> dict:
    """A list of points of an older 3D Slicer (`.fcsv`) as a newer one writes it; without a frame in its head, RAS."""
    lines = text.splitlines()
    head = [line[1:].partition("=") for line in lines if line.startswith("#")]
    said = {key.strip(): value.strip() for key, _, value in head}
    rows = csv.DictReader([line for line in lines if not line.startswith("#")], said["columns"].split(","))
    points = [{"label": row["label"], "position": [float(row[axis]) for axis in "xyz"]} for row in rows]
    frame = said.get("CoordinateSystem", "RAS")
    return {"markups": [{"type": "Fiducial", "coordinateSystem": frame, "controlPoints": points}]}


def _three(value) -> np.ndarray:
    if not numbers(value, 3) or not max(map(abs, value)) <= FARTHEST:
        raise ValueError(f"three numbers of {FARTHEST:g} at most are needed")
    return np.array(value, float)


def _add(known: dict, name: str, value, refuse) -> None:
    if name in known:
        refuse(f"{name!r} is there twice", "give each point and plane a name of its own")
    known[name] = value


def _plane(markup: dict, places: list[np.ndarray], turn: np.ndarray) -> Plane:
    """Point and normal: as written, of the axes of the plane, or through three points."""
    if "normal" in markup:
        normal = turn * _three(markup["normal"])
    elif len(markup.get("orientation", ())) == 9:
        normal = turn * _three(markup["orientation"][2::3])
    elif len(markup.get("baseToNode", ())) == 16:
        normal = turn * _three(markup["baseToNode"][2:11:4])
    else:
        one, two, three = places[:3]
        normal = np.cross(two - one, three - one)
    if not normal.any():
        raise ValueError("a plane without a normal")
    point = turn * _three(markup["center"]) if "center" in markup else places[0]
    return Plane(point, normal / np.linalg.norm(normal))


def _region(markup: dict, turn: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    axes = np.reshape(markup.get("orientation", np.eye(3)), (3, 3))
    size = _three(markup["size"])
    if not (size > 0).all():
        raise ValueError(f"a region of size {markup['size']}")
    half = np.abs(axes) @ (size / 2)
    centre = turn * _three(markup["center"])
    return centre - half, centre + half
