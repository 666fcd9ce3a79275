"""Label maps of a CT by thresholds and a few planes, for a head that nobody has segmented."""

import os
from collections.abc import Mapping
from dataclasses import MISSING, dataclass, field, fields

import numpy as np
import SimpleITK as sitk
from scipy import ndimage

from pinnochio.errors import InputError, refusal
from pinnochio.importing.images import face, read_volume
from pinnochio.importing.segmentation import HEADER, Segmentation, axes_of
from pinnochio.importing.soft_tissue import between, bulk, closed, larger, largest, near_skin
from pinnochio.json_text import read_json
from pinnochio.model.labels import AIR, CRANIUM, SUPERFICIAL, TOUCHING, segment_code

SEGMENTS = ("lefort1", "mandible_distal", "proximal_left", "proximal_right")
LOOSE_CM3 = 5.0  # pieces of bone that hang on nothing and are smaller count as soft: hyoid, larynx, tubes
LOWER, UPPER = 1, 2  # watershed basins
PLANES = ("occlusal", "lefort", "pterygoid", "joint", "split")


@dataclass(frozen=True)
class Plane:
    """Plane through point (3,) mm with the unit normal (3,), LPS."""

    point: np.ndarray
    normal: np.ndarray

    def height(self, places) -> np.ndarray:
        """Signed distance (...,) mm of places (..., 3), positive on the side that the normal points to."""
        return (places - self.point) @ self.normal


@dataclass(frozen=True)
class Cuts:
    """Where the bones of a head are parted, LPS mm.

    occlusal, normal up: between the teeth of both jaws. lefort, normal up: the LeFort I osteotomy. pterygoid, normal
    back: behind the last upper molar, where the maxilla ends. joint, normal up: over the condyles. split, normal back:
    the osteotomy of the rami; without it the mandible is one piece. low, high (3,): the box that is kept, infinite
    where the scan is not cut.
    """

    occlusal: Plane
    lefort: Plane
    pterygoid: Plane
    joint: Plane
    split: Plane | None = None
    low: np.ndarray = field(default_factory=lambda: np.full(3, -np.inf))
    high: np.ndarray = field(default_factory=lambda: np.full(3, np.inf))

    @classmethod
    def read(cls, path: str | os.PathLike) -> "Cuts":
        """Read JSON: {"occlusal": {"point": [x, y, z], "normal": [x, y, z]}, ..., "low": [null, null, z], ...}."""
        refuse = refusal("-", path)
        content = read_json(path, refuse)
        try:
            planes = {name: _plane(content[name]) for name in PLANES if name in content}
            bounds = {
                name: np.array([empty if value is None else float(value) for value in content[name]])
                for name, empty in (("low", -np.inf), ("high", np.inf))
                if name in content
            }
            if unknown := set(content) - {item.name for item in fields(cls)}:
                raise ValueError(f"unknown names {sorted(unknown)}")
            if any(value.shape != (3,) for value in bounds.values()):
                raise ValueError("low and high need three values each")
            return cls(**planes, **bounds)
        except (ValueError, KeyError, TypeError) as error:
            refuse(f"cannot be read as cuts ({error})", "name occlusal, lefort, pterygoid and joint")


def _plane(plane: Mapping) -> Plane:
    point, normal = np.array(plane["point"], float), np.array(plane["normal"], float)
    if point.shape != (3,) or normal.shape != (3,) or not np.isfinite([point, normal]).all() or not normal.any():
        raise ValueError("a plane needs a point and a normal of three numbers each")
    return Plane(point, normal / np.linalg.norm(normal))


def _option(meaning: str, default=MISSING):
    return field(default=default, metadata={"meaning": meaning})


@dataclass(frozen=True)
class Thresholds:
    """Grey values and lengths of a segmentation; each carries its meaning as metadata."""

    skin: float = _option("lowest grey value of tissue")
    bone: float = _option("lowest grey value of bone")
    spacing: float = _option("edge of the label map's voxels, mm", 1.5)
    opening: float = _option("what is thinner than twice this beside the head is taken off (holder, tubes), mm", 3.0)
    closing: float = _option("holes in bone narrower than twice this are closed, mm", 3.0)
    depth: float = _option("soft tissue is kept as far as this from the skin, mm", 28.0)
    aperture: float = _option(
        "openings of the skin narrower than this are mouth and nostrils; see the tongue, too, mm", 10.0
    )
    margin: float = _option("bone nearer than this to the pterygoid plane goes to a jaw by the watershed, mm", 8.0)

    def __post_init__(self):
        refuse = refusal("-", "thresholds")
        if not self.skin < self.bone:
            refuse(f"skin {self.skin} is not below bone {self.bone}", "exchange them")
        if wrong := [item.name for item in fields(self)[2:] if not getattr(self, item.name) > 0]:
            refuse(f"{', '.join(wrong)} is not positive", "give lengths in mm")

    @classmethod
    def options(cls) -> list[tuple[str, str, float | None]]:
        """Name, meaning and default (None: required) of every threshold."""
        return [(i.name, i.metadata["meaning"], None if i.default is MISSING else i.default) for i in fields(cls)]


def read_ct(path: str | os.PathLike, orientation: str = HEADER) -> sitk.Image:
    """Read a CT as an axis-aligned LPS volume; orientation as in :func:`read_segmentation`. Raises InputError."""

    def refuse(problem: str, remedy: str):
        raise InputError("-", path, f"cannot be read as a CT volume: {problem}", remedy)

    image = read_volume(path, refuse, sitk.sitkFloat32)
    try:
        face(image, None if orientation == HEADER else axes_of(orientation), refuse)
        image = sitk.DICOMOrient(image, "LPS")
    except (RuntimeError, ValueError) as error:
        refuse(str(error).strip().splitlines()[-1], "give NRRD, NIfTI or MHA")
    if not np.allclose(image.GetDirection(), np.eye(3).ravel(), atol=1e-4):
        raise InputError("-", path, "its axes are oblique", "resample it to axes along the body, or name the axes")
    return image


def segment_ct(ct: sitk.Image, cuts: Cuts, thresholds: Thresholds) -> Segmentation:
    """Superficial tissue, cranium, maxilla and mandible of a CT (axis-aligned LPS), codes of SEGMENTS; no muscle.

    The CT is resampled linearly to cubes before the thresholds.
    Head. The largest piece of what is denser than air, once everything thinner than twice `opening` is taken off.
    Bones. :func:`_bones`. Below the LeFort I plane and in front of the pterygoid plane lies the maxilla, the largest
    piece there; behind the split plane lie the proximal segments, left and right of the middle of the mandible.
    Soft tissue. What can be reached from the skin through soft tissue on a way of at most `depth`: neither brain nor
    pharynx, which are left out as air. So is the tongue: what has a dental arch on its right and on its left, where
    gaps of the arches narrower than twice `aperture` count as closed, down to `aperture` below the occlusal plane.
    Raises InputError for cuts and thresholds that do not fit the scan.
    """
    spacing = thresholds.spacing
    ct = _isotropic(ct, spacing)
    density = sitk.GetArrayFromImage(ct).transpose(2, 1, 0)
    origin = np.array(ct.GetOrigin())
    places = np.stack(np.indices(density.shape), axis=-1) * spacing + origin
    kept = ((places >= cuts.low) & (places <= cuts.high)).all(axis=-1)
    if not kept.any():
        raise InputError("-", "cuts", "nothing of the scan lies between 'low' and 'high'", "correct the box")

    head = bulk(density > thresholds.skin, thresholds.opening / spacing)
    upper, lower = _bones(density, head, places, cuts, thresholds)
    front = cuts.pterygoid.height(places) < 0
    maxilla = largest(upper & front & (cuts.lefort.height(places) < 0))
    arches = closed(maxilla | (lower & front), thresholds.aperture / spacing)
    oral = between(arches) & (cuts.occlusal.height(places) > -thresholds.aperture)

    labels = np.full(density.shape, AIR, np.uint8)
    labels[near_skin(head, head & ~upper & ~lower & ~oral, spacing, thresholds.depth, thresholds.aperture)] = (
        SUPERFICIAL
    )
    labels[upper] = CRANIUM
    labels[maxilla] = segment_code(0)
    labels[lower] = segment_code(1)
    if cuts.split is not None:
        behind = lower & (cuts.split.height(places) > 0)
        left = places[..., 0] > places[lower][:, 0].mean()
        labels[behind & left] = segment_code(2)
        labels[behind & ~left] = segment_code(3)
    box = ndimage.find_objects(kept.astype(np.uint8))[0]
    corner = origin + spacing * np.array([side.start for side in box])
    return Segmentation(np.ascontiguousarray(labels[box]), np.full(3, spacing), corner)


def _bones(density, head, places, cuts: Cuts, thresholds: Thresholds) -> tuple[np.ndarray, np.ndarray]:
    """Skull with upper jaw, and mandible: a watershed parts them where the bone is least dense, at the joints.

    It starts from the bone below and above the occlusal plane, more than `margin` in front of the pterygoid plane, and
    from the bone above the joint plane. The mandible is the largest piece of its basin, without what is one or two
    voxels thin. Loose pieces of bone are soft. Holes up to twice `closing` wide are closed, in each bone by itself.
    """
    bony = head & (density > thresholds.bone)
    front = cuts.pterygoid.height(places) < -thresholds.margin
    above = cuts.occlusal.height(places) > 0
    markers = np.zeros(density.shape, np.uint8)
    markers[bony & front & ~above] = LOWER
    markers[bony & front & above] = UPPER
    for marker, side in ((LOWER, "below"), (UPPER, "above")):
        if not (markers == marker).any():
            raise InputError("-", "cuts", f"there is no bone {side} the occlusal plane", "correct the planes or 'bone'")
    markers[bony & (cuts.joint.height(places) > 0)] = UPPER
    lower = bulk(bony & (_watershed(-density, markers) == LOWER), 1)
    upper = larger(bony & ~lower, LOOSE_CM3 * 1000 / thresholds.spacing**3, TOUCHING)
    upper = closed(upper, thresholds.closing / thresholds.spacing) & ~lower
    return upper, closed(lower, thresholds.closing / thresholds.spacing) & ~upper


def _isotropic(ct: sitk.Image, spacing: float) -> sitk.Image:
    extent = (np.array(ct.GetSize()) - 1) * ct.GetSpacing()
    size = (np.floor(extent / spacing + 1e-6).astype(int) + 1).tolist()
    return sitk.Resample(
        sitk.Cast(ct, sitk.sitkFloat32),
        size=size,
        interpolator=sitk.sitkLinear,
        outputOrigin=ct.GetOrigin(),
        outputSpacing=[spacing] * 3,
        outputDirection=ct.GetDirection(),
    )


def _watershed(height, markers) -> np.ndarray:
    """Basin of each voxel, flooded from the markers up the height."""
    images = [sitk.GetImageFromArray(np.ascontiguousarray(array)) for array in (height, markers)]
    return sitk.GetArrayFromImage(sitk.MorphologicalWatershedFromMarkers(*images, markWatershedLine=False))
