"""What a bone segment does, by its name: which segments a case may have together, and which of them carries a place."""

from collections.abc import Sequence

import numpy as np

from pinnochio.errors import InputError, refusal
from pinnochio.plans.plan import Plan

# What a segment does, by the beginning of its name; the first that fits counts.
ROLES = {"lefort": "maxilla", "maxilla": "maxilla", "mandible": "distal", "distal": "distal", "proximal": "proximal",
         "ramus": "proximal", "chin": "chin", "genio": "chin"}  # fmt: skip
UNCUT = "mandible"  # name and role of a mandible that is not cut and turns about its condyles
GUESS = " (a guess: look at the picture)"  # ends what decided a cut that nobody has placed
FRONT = "front"  # what the foremost piece of a segmental maxilla has in its name
# Places of the face's skeleton and the roles that carry each, the nearest first.
PLACES = {"upper": ("maxilla",), "lower": ("distal", UNCUT), "chin": ("chin", "distal", UNCUT)}


def role(segment: str) -> str:
    """maxilla | distal | mandible (uncut) | proximal | chin, by the segment's name."""
    known = known_role(segment)
    if known is None:
        remedy = f"start its name with {', '.join(ROLES)}"
        raise InputError("?", "segments", f"segment {segment!r} has no known role", remedy)
    return known


def known_role(segment: str) -> str | None:
    """The role, None for a name that tells none."""
    if segment == UNCUT:
        return UNCUT
    return next((what for start, what in ROLES.items() if segment.startswith(start)), None)


def of_role(segments: Sequence[str], *roles: str) -> list[str]:
    """The segments of these roles, in their order."""
    return [name for name in segments if known_role(name) in roles]


def carriers(segments: Sequence[str], place: str) -> list[str]:
    """The segments of a case that carry a place (of PLACES) at the midline; none where that bone is not cut.

    Of a maxilla in pieces the foremost one carries it, else all of them together.
    """
    members = next(filter(None, (of_role(segments, what) for what in PLACES[place])), [])
    return [name for name in members if FRONT in name] or members


def displacement_at(plan: Plan, place: str, points: np.ndarray) -> np.ndarray:
    """Displacement (k, 3) mm of bone points (k, 3) at a place under a plan; zero where the plan moves nothing there."""
    moved = [plan.motion(name).displacement(points) for name in carriers(list(plan.motions), place)]
    return np.mean(moved, axis=0) if moved else np.zeros_like(points)


def check_together(segments: Sequence[str], case: str, file: object) -> None:
    """InputError for segments that no case can have together: an uncut bone beside its own pieces, or none at all."""
    refuse = refusal(case, file)
    if not segments:
        refuse("it holds no bone segment", "label the bones that the plan moves; 'segments' names them")
    pieces = of_role(segments, "maxilla")
    whole = [name for name in pieces if any(other.startswith(f"{name}_") for other in pieces)]
    cut = of_role(segments, "distal", "proximal") if UNCUT in segments else []
    for name, parts in ((whole[:1], pieces), ([UNCUT] if cut else [], cut)):
        if name:
            others = ", ".join(part for part in parts if part != name[0])
            problem = f"{name[0]!r} is the whole bone, and its pieces {others} are labelled too"
            refuse(problem, "label either the whole bone or its pieces")
