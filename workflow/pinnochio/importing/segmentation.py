"""Reads what users bring: segmentations, plans and post-operative surfaces, checked, in LPS millimetres."""

import gzip
import logging
import os
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import SimpleITK as sitk
from scipy import ndimage

from pinnochio.errors import InputError, refusal
from pinnochio.files import replacing
from pinnochio.geometry.closed_surfaces import read_triangles
from pinnochio.geometry.rigid import LARGEST_TRANSLATION
from pinnochio.geometry.triangles import enclosed_volume
from pinnochio.importing.images import face, read_stored_image
from pinnochio.importing.scan_checks import check_joined, thinned, without_spikes
from pinnochio.importing.segment_files import Segment, check_extent, read_segments, read_surfaces
from pinnochio.importing.soft_tissue import hollows
from pinnochio.model.labels import AIR, CRANIUM, TISSUES, TOUCHING, internal_codes
from pinnochio.model.surfaces import BoneSurface
from pinnochio.plans.plan import Plan
from pinnochio.plans.roles import check_together

LOG = logging.getLogger(__name__)
HEADER = "header"
REQUIRED = ("superficial", "cranium")
BESIDE = 0.1  # of the labelled rim of a piece: a structure that it may be part of [I]
LARGE = 250.0  # cm3 of a structure, at most, that what nothing names is held against [I]


@dataclass(frozen=True)
class Segmentation:
    """labels (nx, ny, nz) uint8 internal codes [ix, iy, iz]; spacing (3,) mm; origin (3,) centre of voxel 0, LPS.

    segments: the bone segments that it holds, in the order of their codes; axes: where the axes of the file pointed;
    closed: planes that close openings of surfaces, by structure.
    """

    labels: np.ndarray
    spacing: np.ndarray
    origin: np.ndarray
    segments: tuple[str, ...] = ()
    axes: str = "LPS"
    closed: Mapping[str, Sequence[dict]] = field(default_factory=dict)

    @property
    def label_map(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """What surfaces and meshes are made of: labels, spacing, origin."""
        return self.labels, self.spacing, self.origin


def read_segmentation(
    path: str | os.PathLike,
    case: str,
    label_values: Mapping[str, int | str],
    segments: Sequence[str],
    orientation: str = HEADER,
    unnamed_percent: float = 100.0,
) -> Segmentation:
    """Read a segmentation in any orientation into internal codes on an axis-aligned LPS grid.

    path: a label map (NIfTI, NRRD, MHA), a 3D Slicer `.seg.nrrd`, a DICOM-SEG (`.dcm`), or a folder with one surface
    per structure (STL, PLY, OBJ, VTP; voxels of 1 mm; what is open is closed). label_values: of "superficial",
    "muscle", "cranium" and of every segment the voxel value (of a DICOM-SEG the segment number; a surface then bears
    the name of its structure), or the name that the file gives it. segments: those that a case may have; its own are
    those that it holds, coded in this order. Where structures overlap, bone goes over muscle, muscle over superficial
    tissue, a segment over the cranium and over segments listed before it. What a bone encloses is bone.
    What is not named counts as what else the file has there, or as air, with a warning; it is refused where it makes up
    more than `unnamed_percent` of the structure that it lies against, unless `label_values` lists it under "left_out":
    that is air, in soft tissue too. Muscle may be missing in `label_values` and in the file; the result then holds
    none.

    orientation: where the voxel axes of a file with a wrong header point, as a code such as "RAS" (first axis to the
    patient's right, second anterior, third superior); of surfaces, where their axes point. An oblique grid is resampled
    by nearest neighbour on an axis-aligned one of the same spacing. Raises InputError for what the user must mend.
    """
    refuse = refusal(case, path)
    structures = internal_codes(tuple(segments))
    for name in structures:
        if name not in label_values and name != "muscle":
            refuse(f"the configuration gives no voxel value for {name!r}", f"add {name!r} to 'labels'")
    optional = ("muscle", *segments)
    direction = axes_of(orientation) if orientation != HEADER else None
    if Path(path).is_dir():
        label_values = {name: name if isinstance(value, int) else value for name, value in label_values.items()}
        image, parts = read_surfaces(path, direction, refuse)
    else:
        image, parts = read_segments(path, refuse)
        face(image, direction, refuse)
    if any(isinstance(value, str) for value in label_values.values()) and any(part.name for part in parts):
        # Names count: the values of others may be those by default, and another segment's in the file.
        numbers = [name for name, value in label_values.items() if isinstance(value, int) and name not in REQUIRED]
        label_values = {name: value for name, value in label_values.items() if name not in numbers}
    wanted = {name: label_values[name] for name in structures if name in label_values}
    chosen = _chosen(parts, wanted, optional, case, path, refuse)
    present = tuple(name for name in segments if name in chosen)
    check_together(present, case, path)
    codes = internal_codes(present)
    values = np.full(image.GetSize()[::-1], AIR, np.uint8)
    for name, part in chosen.items():
        values[part.voxels()] = codes[name]
    others = [part for part in parts if part not in chosen.values()]
    air = np.zeros(values.shape, bool)
    for part in others:
        if _left_out(part, label_values):
            air |= part.voxels() & (values < CRANIUM)
    values[air] = AIR
    voxel = float(np.prod(image.GetSpacing()))
    _fill(values, codes, air, voxel, case)
    check_extent(labelled_extent(values != AIR, image.GetSpacing()[::-1]), refuse)
    unnamed = [part for part in others if not _left_out(part, label_values)]
    _check_unnamed(values, unnamed, label_values, codes, unnamed_percent, voxel, refuse)
    axes = sitk.DICOMOrientImageFilter.GetOrientationFromDirectionCosines(image.GetDirection())
    coded = sitk.GetImageFromArray(values)
    coded.CopyInformation(image)
    coded = _axis_aligned(coded)
    labels = np.ascontiguousarray(sitk.GetArrayFromImage(coded).transpose(2, 1, 0))
    for name, part in chosen.items():
        if name != "muscle" and not (labels == codes[name]).any():
            what = "tissue" if name in TISSUES else "bone"
            refuse(f"{what} {name!r} ({part}) is empty or covered by other structures", "label it where it alone is")
    closed = {name: part.closed for name, part in chosen.items() if part.closed}
    return Segmentation(labels, np.array(coded.GetSpacing()), np.array(coded.GetOrigin()), present, axes, closed)


def _fill(values, codes: Mapping[str, int], air, voxel: float, case: str) -> None:
    """Turn what a bone encloses into bone, but for what is air (bool) on purpose; voxel: its volume, mm3."""
    for name, code in codes.items():
        enclosed = hollows(values == code, voxel) & ~air & (values < CRANIUM) if code >= CRANIUM else air[:0]
        if enclosed.any():
            LOG.warning("case %r: %.1f cm3 that %r encloses are bone", case, enclosed.sum() * voxel / 1000, name)
            values[enclosed] = code


def axes_of(orientation: str) -> np.ndarray:
    """Direction (3, 3) in LPS of the axes that a code such as "RAS" names."""
    return np.reshape(sitk.DICOMOrientImageFilter.GetDirectionCosinesFromOrientation(orientation), (3, 3))


def _chosen(
    parts: Sequence[Segment], wanted: Mapping[str, int | str], optional: Sequence[str], case: str, path, refuse
) -> dict[str, Segment]:
    """The segment of each structure, in the order of `wanted`; the `optional` ones may have none."""
    named = any(part.name is not None for part in parts)
    listed = ", ".join(map(str, parts)) or "nothing"
    chosen = {}
    for structure, value in wanted.items():
        if isinstance(value, str) and not named:
            refuse(
                f"'labels' gives {structure!r} the name {value!r}, but a plain label map has no names",
                f"give {structure!r} its voxel value in 'labels', or save the segmentation with names (.seg.nrrd)",
            )
        matching = [part for part in parts if value == (part.name if isinstance(value, str) else part.value)]
        names = {plain_name(name): name for name in wanted}
        for part in matching:
            if (other := names.get(plain_name(part.name or ""), structure)) != structure:
                problem = f"segment {part} bears the name of {other!r}, and 'labels' takes it for {structure!r}"
                refuse(problem, "correct 'labels', or the name in the file")
        if len(matching) > 1:
            refuse(
                f"{len(matching)} segments are called {value!r} ({', '.join(map(str, matching))})",
                f"give {structure!r} the name of its segment in 'labels', and each segment a name of its own",
            )
        if matching:
            chosen[structure] = matching[0]
        elif structure in optional:
            if structure == "muscle":
                LOG.warning(
                    "case %r: %s: nothing carries the label %r of 'muscle'; it holds %s", case, path, value, listed
                )
        elif named:
            what = "is called" if isinstance(value, str) else "has the number"
            refuse(f"no segment {what} {value!r} ({structure!r}); it holds {listed}", "correct the name in 'labels'")
        else:
            what = "tissue" if structure in TISSUES else "bone"
            refuse(
                f"{what} {structure!r} (voxel value {value}) is empty",
                f"label {structure!r} in the segmentation, or correct 'labels' or 'segments' in the configuration",
            )
    if extra := [str(part) for part in parts if part not in chosen.values()]:
        named_so = {plain_name(value): value for name, value in wanted.items() if isinstance(value, str)}
        for part in parts:
            meant = named_so.get(plain_name(part.name or ""))
            if part not in chosen.values() and meant and meant not in {other.name for other in chosen.values()}:
                refuse(f"it holds {part}, where 'labels' says {meant!r}", "write the name in one way")
        what = "segments" if named else "voxel values"
        LOG.warning("case %r: %s: %s %s are not named in 'labels'; not used", case, path, what, ", ".join(extra))
    return chosen


def plain_name(name: str) -> str:
    """A name without regard to case, blanks and signs: how people write the same one."""
    return re.sub(r"[\W_]", "", name.lower())


def _left_out(part: Segment, label_values: Mapping) -> bool:
    """Whether the configuration says that the segment is air on purpose (airway, brain)."""
    return bool({part.name, part.value} & set(label_values.get("left_out", ())))


def _check_unnamed(
    values, unnamed: Sequence[Segment], label_values: Mapping, codes, limit: float, voxel: float, refuse
) -> None:
    """Refuse voxels that no label names where they make up more than `limit` percent of a structure beside them.

    values [iz, iy, ix] internal codes; voxel: its volume, mm3. A connected piece may belong to each structure that
    makes up BESIDE of its rim. A larger structure counts as LARGE: a maxilla is little beside a skull.
    """
    most = LARGE * 1000 / voxel
    names = {code: name for name, code in codes.items()}
    for part in unnamed:
        piece, _ = ndimage.label(part.voxels() & (values < CRANIUM), TOUCHING)
        lost: dict[int, int] = {}
        for number, box in enumerate(ndimage.find_objects(piece), 1):
            wide = tuple(slice(max(side.start - 1, 0), side.stop + 1) for side in box)
            inside = piece[wide] == number
            rim = values[wide][ndimage.binary_dilation(inside, TOUCHING) & ~inside]
            around = np.bincount(rim[rim != AIR], minlength=1)
            for code in np.flatnonzero(around >= max(1, BESIDE * around.sum())):
                lost[int(code)] = lost.get(int(code), 0) + int(inside.sum())
        for code, voxels in sorted(lost.items(), reverse=True):  # bones first
            share = 100 * voxels / (voxels + min(int((values == code).sum()), most))
            if share <= limit:
                continue
            said = f"{voxels} voxels of {part} beside {names[code]!r} ({share:.3g} % of it) would become air or tissue"
            listed = [
                name for name, value in label_values.items() if name != "left_out" and value in (part.name, part.value)
            ]
            if listed:
                problem = f"{said}: 'labels' calls them {listed[0]!r}, which is not among 'segments'"
                refuse(problem, f"add {listed[0]!r} to 'segments', or give the value to one of them")
            refuse(
                f"{said}, because nothing in 'labels' names them",
                "name them in 'labels'; what is air on purpose, such as an airway, belongs to 'labels.left_out'",
            )


def write_segmentation(labels, spacing, origin, path: str | os.PathLike) -> None:
    """Write labels [ix, iy, iz] as they are, axis-aligned LPS; the same labels give the same bytes."""
    image = sitk.GetImageFromArray(np.ascontiguousarray(np.asarray(labels).transpose(2, 1, 0)))
    image.SetSpacing([float(value) for value in spacing])
    image.SetOrigin([float(value) for value in origin])
    with replacing(path) as temporary:
        if str(path).endswith(".nii.gz"):
            # Compressed here: a gzip header normally holds the time and the name.
            plain = temporary.with_name(temporary.name.removesuffix(".gz"))
            try:
                sitk.WriteImage(image, str(plain))
                temporary.write_bytes(gzip.compress(plain.read_bytes(), compresslevel=6, mtime=0))
            finally:
                plain.unlink(missing_ok=True)
        else:
            sitk.WriteImage(image, str(temporary), useCompression=not str(path).endswith(".nii"))


def read_labels(path: str | os.PathLike) -> Segmentation:
    """Read what :func:`write_segmentation` wrote, without checks."""
    image = _axis_aligned(read_stored_image(path))
    labels = np.ascontiguousarray(sitk.GetArrayFromImage(image).transpose(2, 1, 0)).astype(np.uint8)
    return Segmentation(labels, np.array(image.GetSpacing()), np.array(image.GetOrigin()))


def check_plan(plan: Plan, segments: Sequence[str], path: str | os.PathLike) -> None:
    """Refuse a plan that does not name exactly the segments of its case, each once."""
    refuse = refusal(plan.case, path)
    listed = ", ".join(segments)
    for name in plan.motions:
        if name not in segments:
            problem = f"it moves {name!r}, which the segmentation does not hold ({listed})"
            refuse(problem, f"rename {name!r} in the plan, or label it (one of 'segments' in the configuration)")
    for name in segments:
        if name not in plan.motions:
            problem = f"it says nothing of {name!r}, which the segmentation holds ({listed})"
            refuse(problem, f"give {name!r} its motion; one that stays where it is has the identity")


def check_travel(plan: Plan, bone: BoneSurface, segments: Sequence[str], path: str | os.PathLike) -> None:
    """Refuse a plan that carries a bone farther than any operation, as a rotation about a far pivot may."""
    for index, name in enumerate(segments):
        moved = plan.motion(name).displacement(bone.points[bone.segment == index])
        farthest = float(np.linalg.norm(moved, axis=1).max(initial=0.0))
        if not farthest <= LARGEST_TRANSLATION:
            remedy = f"check pivot, rotation and frame (LPS, mm); bones move {LARGEST_TRANSLATION:.0f} mm at most"
            raise InputError(plan.case, path, f"it carries a point of {name!r} {farthest:.4g} mm away", remedy)


def read_postop(path: str | os.PathLike, case: str, skin_points) -> tuple[np.ndarray, np.ndarray]:
    """Read a skin (PLY, STL, OBJ, VTP): points (p, 3) mm, outward faces (f, 3) int32, in its own frame.

    Its size is compared with that of the pre-operative skin_points (k, 3) mm: centimetres and metres are turned into
    millimetres with a warning. Spikes are left out, and a scan of very many triangles is thinned, both with a warning.
    Raises InputError for any other size and for what is no surface.
    """
    refuse = refusal(case, path)
    points, faces = read_triangles(path, refuse)
    points = in_millimetres(points, skin_points, "skin", case, path)
    points, faces = thinned(*without_spikes(points, faces, case, path), case, path)
    check_joined(points, faces, case, path)
    # A face is a bowl: seen from its middle, most of it looks away.
    if enclosed_volume(points - points.mean(axis=0), faces) < 0:
        LOG.warning("case %r: %s: its triangles look inward; turned round", case, path)
        faces = np.ascontiguousarray(faces[:, ::-1])
    return points, faces


def in_millimetres(points, reference, what: str, case: str, path: str | os.PathLike) -> np.ndarray:
    """Points (p, 3) of a patient's skin or bone in mm: their size is compared with that of `reference` (k, 3) mm.

    Centimetres and metres are turned into millimetres with a warning; InputError for any other size.
    """
    ratio = _diagonal(points) / _diagonal(reference)
    for unit, factor in (("metres", 1000.0), ("centimetres", 10.0)):
        if 1 / 2.5 < ratio * factor < 2.5:
            LOG.warning("case %r: %s: %.3g times the size of the %s in mm; taken as %s", case, path, ratio, what, unit)
            points, ratio = points * factor, ratio * factor
            break
    if not 0.25 < ratio < 4:
        problem = f"the surface is {ratio:.3g} times the size of the patient's {what}"
        remedy = f"give this patient's {what} in millimetres, centimetres or metres, the whole face and little else"
        raise InputError(case, path, problem, remedy)
    return points


def _axis_aligned(image: sitk.Image) -> sitk.Image:
    """The image in LPS with the identity as direction; resampled by nearest neighbour only if it is oblique."""
    image = sitk.DICOMOrient(image, "LPS")
    direction = np.array(image.GetDirection()).reshape(3, 3)
    if np.abs(direction - np.eye(3)).max() < 1e-4:  # what float32 headers leave of an identity
        image.SetDirection(np.eye(3).ravel())
        return image
    size, spacing = np.array(image.GetSize()), np.array(image.GetSpacing())
    corners = np.array(np.meshgrid(*[(0, n - 1) for n in size], indexing="ij")).reshape(3, -1).T.tolist()
    places = np.array([image.TransformContinuousIndexToPhysicalPoint(corner) for corner in corners])
    low, high = places.min(axis=0), places.max(axis=0)
    wanted = np.ceil((high - low) / spacing - 1e-6).astype(int) + 1
    return sitk.Resample(
        image,
        size=wanted.tolist(),
        interpolator=sitk.sitkNearestNeighbor,
        outputOrigin=low.tolist(),
        outputSpacing=spacing.tolist(),
        outputDirection=np.eye(3).ravel().tolist(),
    )


def labelled_extent(inside, spacing) -> float | None:
    """Longest side in mm of the box round the voxels inside [i, j, k]; None if there are none."""
    box = ndimage.find_objects(inside.astype(np.uint8))
    return max((side.stop - side.start) * step for side, step in zip(box[0], spacing, strict=True)) if box else None


def _diagonal(points) -> float:
    """Size in mm of what most of the points lie in; a spike says nothing of it."""
    low, high = np.percentile(points, [1, 99], axis=0)
    return float(np.linalg.norm(high - low))
