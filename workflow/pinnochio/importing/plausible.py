"""What no head looks like, whatever format it comes in: voxels too coarse for bone, bones of a size that nobody has."""

import os
from collections.abc import Sequence

import numpy as np
from scipy import ndimage

from pinnochio.errors import refusal
from pinnochio.model.labels import AIR, CRANIUM, internal_codes, segment_name
from pinnochio.plans.roles import UNCUT, known_role

COARSEST = 5.0  # mm; slices of CT are no thicker, and plates of bone are thinner already [I]
IN_THE_AIR = 0.95  # share of the voxels round a bone; 0.85 in a model of a face with nothing behind the maxilla [X]
# Usual volumes, cm3, with teeth (docs/reference/anatomy.md): whole bones, then pieces of them by their role.
BONES = {"skull": (60.0, 1300.0), "mandible": (30.0, 130.0)}
PIECES = {"maxilla": (12.0, 75.0), "distal": (15.0, 95.0), "proximal": (3.5, 35.0), "chin": (1.0, 16.0)}
DISTAL = 0.48  # of a mandible that is split, at least, is not rami
SIDES = 2.0  # the larger of two proximal segments by the smaller one, at most
WIDTHS = {"maxilla": (45.0, 110.0), "distal": (45.0, 115.0)}  # mm
BEYOND = 1.6  # times out of a range is no head


def check_plausible(labels, spacing, segments: tuple[str, ...], case: str, file: str | os.PathLike) -> None:
    """Refuse (InputError) voxels (mm) that are too coarse and bones round which there is nothing but air.

    labels (nx, ny, nz) internal codes.
    """
    refuse = refusal(case, file)
    coarsest = float(np.max(spacing))
    if not coarsest <= COARSEST:
        problem = f"its voxels measure {coarsest:.3g} mm, and bone is thinner"
        refuse(problem, f"segment on a scan of {COARSEST:g} mm or less, or correct the spacing")
    beside = ndimage.generate_binary_structure(3, 1)
    for code, box in enumerate(ndimage.find_objects(labels), 1):
        if box is None or code < CRANIUM:
            continue
        wide = tuple(slice(max(side.start - 1, 0), side.stop + 1) for side in box)
        bone = labels[wide] == code
        around = labels[wide][ndimage.binary_dilation(bone, beside) & ~bone]
        share = float((around == AIR).mean()) if len(around) else 0.0
        if not share <= IN_THE_AIR:
            name = segment_name(code - CRANIUM - 1, segments)
            problem = f"{100 * share:.0f} % of what surrounds {name!r} is air: no tissue holds it"
            refuse(problem, f"label the tissue round {name!r}, or correct where it lies")


def unlike_people(labels, spacing, segments: Sequence[str]) -> list[tuple[str, float]]:
    """What of a head's bones is unlike people's, in words, and how many times it is out of the usual range.

    Volumes of skull and mandible and of their pieces, widths and places of the pieces, the share of the distal segment,
    and both proximal segments against each other. What the border of the volume cuts may be as small as it is.
    """
    codes = internal_codes(tuple(segments))
    bones = {name: np.isin(labels, code) for name, code in codes.items() if code >= CRANIUM}
    roles = {name: known_role(name) for name in segments}
    wholes = {
        "skull": [name for name in bones if name == "cranium" or roles[name] == "maxilla"],
        "mandible": [name for name in bones if roles.get(name) in ("distal", "proximal", "chin", UNCUT)],
    }
    wholes |= {"maxilla": [name for name in segments if roles[name] == "maxilla"]}
    odd: list[tuple[str, float]] = []

    def compare(what: str, value: float, unit: str, low: float, high: float) -> None:
        if not low <= value <= high:
            shown = f"{what}: {value:.3g} {unit}, usual are {low:g} to {high:g}"
            odd.append((shown, max(value / high, low / max(value, 1e-9))))

    measured = {}
    for name, parts in [*wholes.items(), *((name, [name]) for name in segments if roles[name] != "maxilla")]:
        mask = np.logical_or.reduce([bones[part] for part in parts]) if parts else np.zeros(1, bool)
        if not mask.any():
            continue
        index, role = np.argwhere(mask), name if name in wholes else roles[name]
        cut = bool((index.min(axis=0) == 0).any() or (index.max(axis=0) == np.array(labels.shape) - 1).any())
        # What the plan moves may be a part of the mandible alone.
        cut |= name == "mandible" and not {"distal", UNCUT} & {roles[part] for part in parts}
        measured[name] = len(index) * float(np.prod(spacing)) / 1000, index.mean(axis=0) * spacing, cut
        if usual := (BONES | PIECES).get(role):
            compare(name, measured[name][0], "cm3", 0.0 if cut else usual[0], usual[1])
        if usual := WIDTHS.get(role):
            width = float((np.ptp(index[:, 0]) + 1) * spacing[0])
            compare(f"width of {name}", width, "mm", 0.0 if cut else usual[0], usual[1])
    rami = [name for name in segments if roles[name] == "proximal" and name in measured]
    distal = next((name for name in segments if roles[name] == "distal" and name in measured), None)
    if distal and rami:
        front = measured[distal]
        if not any(measured[name][2] for name in rami):
            share = 1 - sum(measured[name][0] for name in rami) / measured["mandible"][0]
            compare("share of the mandible in front of the rami", 100 * share, "%", 100 * DISTAL, 100.0)
        odd += [(f"{name} lies in front of {distal}", np.inf) for name in rami if measured[name][1][1] < front[1][1]]
    if len(rami) == 2 and not any(measured[name][2] for name in rami):
        low, high = sorted(measured[name][0] for name in rami)
        compare(f"larger of {' and '.join(rami)} by the smaller", high / low, "times", 1.0, SIDES)
    return odd


def judged(odd: Sequence[tuple[str, float]], accept: bool, cut: bool, case: str, file: object) -> list[str]:
    """What must be looked at with care; refused where it is no head or, of pieces that were cut by rule, unlike
    people's and not accepted (`osteotomy.accept`)."""
    refuse = refusal(case, file)
    remedy = "look at it; give planes or landmarks as markups, or correct the labels; or set osteotomy.accept"
    remedy = remedy if cut else "correct the labels; or, if this is so, set osteotomy.accept"
    for words, times in odd if not accept else ():
        if times > BEYOND:
            refuse(f"unlike anybody's: {words}", remedy)
        if cut:
            refuse(f"the cuts by rule make pieces unlike people's: {words}", remedy)
    return [words for words, _ in odd]
