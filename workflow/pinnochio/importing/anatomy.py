"""Compares the anatomy of a labelled head with the frame that its file claims: turned, mirrored, stretched heads."""

from collections.abc import Sequence

import numpy as np

from pinnochio.errors import InputError, refusal
from pinnochio.model.labels import CRANIUM, segment_code
from pinnochio.plans.roles import UNCUT, known_role

AS_IT_SHOULD_BE = "as it should be"
LOWER = ("distal", UNCUT, "proximal", "chin")
UPRIGHT = 0.35  # least cosine between the way from the lower to the upper bones and the vertical [I]
CLEAR = 10.0  # mm: a jaw's arms lie so far behind its middle, at least, where it tells front from back [I]
MIDDLE, ARMS = 0.15, 0.35  # of the jaw's width about its middle: the chin, and beyond which its arms lie [I]
RAMUS = 15.0  # mm by which the arms rise above the front, where rami are labelled [I]
LEAST_WIDTH = 30.0  # mm: a narrower piece says nothing [I]
# Whole lower jaws: the real one and the virtual ones are 112 mm wide, 0.74-0.84 of that high and 0.75-0.8 deep [X].
WIDTH = (75.0, 160.0)  # mm [I]: from a child's to a giant's
SHARE = {"height": (0.5, 1.2), "depth": (0.5, 1.25)}  # of the width [I]
TURNED = {"x": "left and right are exchanged", "y": "the face looks backwards", "z": "the head is upside down"}
OPPOSITE = dict(zip("LRPASI", "RLAPIS", strict=True))


def check_anatomy(
    labels, spacing, segments: Sequence[str], axes: str, case: str, file: object, upper_teeth=None, lower_teeth=None
) -> dict[str, str]:
    """What the anatomy says of the frame: `up`, `front`, `sides` and `size`, "as it should be" or why it is unknown.

    labels (nx, ny, nz) internal codes [ix, iy, iz]; spacing (3,) mm; axes: where the axes of the file point, such as
    "LPS"; upper_teeth, lower_teeth (nx, ny, nz) bool where they are labelled apart.

    Up: cranium and upper jaw lie above the lower jaw, upper above lower teeth. Front: the arms of the lower jaw lie
    behind its middle. Sides: what is called left lies at larger x than what is called right; a head without such names
    looks the same in a mirror. Size: width of the lower jaw, its height and depth by its width; not where the volume
    cuts it. Raises InputError, with the likely remedy, where one contradicts the frame.
    """
    refuse = refusal(case, file)
    labels, spacing = np.asarray(labels), np.asarray(spacing, float)
    of = {name: segment_code(index) for index, name in enumerate(segments)}
    lower = np.isin(labels, [code for name, code in of.items() if known_role(name) in LOWER])
    if not lower.any():
        unknown = "unknown: no lower jaw is labelled"
        return dict.fromkeys(("up", "front", "size"), unknown) | {"sides": "unknown"}
    upper = (labels >= CRANIUM) & ~lower
    jaw = np.argwhere(lower)
    cut = {name: bool(jaw[:, axis].min() == 0 or jaw[:, axis].max() == labels.shape[axis] - 1)
           for axis, name in enumerate("xyz")}  # fmt: skip
    jaw = jaw * spacing
    good, flipped, said = AS_IT_SHOULD_BE, set(), {}

    rise = _centre(upper, spacing) - jaw.mean(axis=0) if upper.any() else np.array([0, 0, 1.0])
    sideways = abs(rise[2]) < UPRIGHT * np.linalg.norm(rise)
    teeth = [mask for mask in (upper_teeth, lower_teeth) if mask is not None and mask.any()]
    over = _centre(teeth[0], spacing)[2] > _centre(teeth[1], spacing)[2] if len(teeth) == 2 else rise[2] > 0
    if rise[2] < 0:
        flipped.add("z")
    elif not over:
        refuse("the upper teeth lie below the lower teeth", "exchange their values in 'labels'")
    said["up"] = good

    back = {across: _behind(jaw, across, along) for across, along in ((0, 1), (1, 0))}
    if abs(back[1]) > max(CLEAR, abs(back[0])):
        sideways = True
    elif back[0] < -CLEAR:
        flipped.add("y")
    said["front"] = good if abs(back[0]) > CLEAR else "unknown: the lower jaw shows no arms"
    pairs = [(name, name[: -len("left")] + "right") for name in of if name.endswith("left")]
    pairs = [pair for pair in pairs if pair[1] in of and all((labels == of[name]).any() for name in pair)]
    exchanged = [_centre(labels == of[one], spacing)[0] < _centre(labels == of[two], spacing)[0] for one, two in pairs]
    if any(exchanged):
        flipped.add("x")
    said["sides"] = good if pairs else "unknown: nothing labelled tells left from right"
    if sideways:
        refuse(
            f"the head lies on its side: in the frame of the file (axes {axes}) the lower jaw is not below the skull, "
            "or the face looks to one side",
            "correct the header, or set 'orientation' to where the voxel axes really point",
        )
    if flipped:
        wrong = " and ".join(TURNED[axis] for axis in "zyx" if axis in flipped)
        pair = f" ({pairs[exchanged.index(True)][0]!r} lies on the right)" if "x" in flipped else ""
        refuse(f"{wrong}{pair} in the frame of the file (axes {axes})", _remedy(flipped, axes, pairs))
    said["size"] = _check_size(jaw, cut, case, file)
    return said


def _centre(mask, spacing) -> np.ndarray:
    return np.argwhere(mask).mean(axis=0) * spacing


def _behind(jaw, across: int, along: int) -> float:
    """How far (mm) the arms of a jaw, points (k, 3), lie behind its middle, if `across` is its width."""
    low, high = jaw[:, across].min(), jaw[:, across].max()
    off = np.abs(jaw[:, across] - (low + high) / 2) / max(high - low, 1e-9)
    middle, arms = jaw[off < MIDDLE, along], jaw[off > ARMS, along]
    return float(arms.mean() - middle.mean()) if len(middle) and len(arms) else 0.0


def _remedy(flipped: set[str], axes: str, pairs) -> str:
    """What to do about exchanged axes: the likely orientation of the file."""
    if flipped == {"x"}:
        return "exchange left and right in 'labels', or set 'orientation' if the header is mirrored"
    likely = set(flipped)
    # A head that looks backwards has been turned, unless what is called left still lies on the left.
    if flipped == {"y"} and not pairs:
        likely.add("x")
    letters = {"x": "LR", "y": "PA", "z": "SI"}
    exchanged = "".join(letters[axis] for axis in likely)
    code = "".join(OPPOSITE[letter] if letter in exchanged else letter for letter in axes)
    unknown = "" if pairs else "; make sure which side is left, because nothing that is labelled tells"
    return f"correct the header, or set 'orientation' to where the voxel axes really point (probably {code}){unknown}"


def _check_size(jaw, cut: dict[str, bool], case: str, file: object) -> str:
    """Compare the lower jaw, points (k, 3) mm, with lower jaws of people; InputError for another size or shape."""
    width, depth, height = np.ptp(jaw, axis=0)
    front = jaw[jaw[:, 1] < jaw[:, 1].min() + depth / 3, 2].max()
    rear = jaw[jaw[:, 1] > jaw[:, 1].max() - depth / 3, 2].max()
    whole = rear > front + RAMUS * min(1.0, height / 80)
    if width < LEAST_WIDTH:
        return "unknown: hardly any lower jaw is labelled"
    measured = f"the lower jaw is {width:.0f} mm wide, {depth:.0f} mm deep and {height:.0f} mm high"
    remedy = "correct the voxel spacing of the file (mm; distance of slices as well as size of pixels)"

    def refuse(what: str):
        raise InputError(case, file, f"{measured}: {what}", remedy)

    if not cut["x"] and (width > WIDTH[1] or (whole and width < WIDTH[0])):
        refuse(f"people's are {WIDTH[0]:.0f} to {WIDTH[1]:.0f} mm wide")
    for name, value, axis in (("height", height, "z"), ("depth", depth, "y")):
        low, high = SHARE[name]
        if cut["x"]:
            continue
        if value > high * width or (whole and not cut[axis] and value < low * width):
            refuse(f"its {name} is {value / width:.2f} of its width, where {low:g} to {high:g} are usual")
    return AS_IT_SHOULD_BE if whole and not any(cut.values()) else "unknown in part: the lower jaw is not whole"
