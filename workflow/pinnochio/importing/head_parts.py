"""Puts what a free tool segments of a head, one file or several, into parts on one grid, with its soft tissue."""

import logging
import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

import numpy as np
import SimpleITK as sitk
from scipy import ndimage

from pinnochio.errors import InputError, refusal
from pinnochio.files import entries
from pinnochio.geometry.closed_surfaces import surfaces_in
from pinnochio.importing.images import face, read_volume
from pinnochio.importing.presets import (
    BONE_OF,
    CANAL,
    HEAD,
    LOWER,
    LOWER_TEETH,
    MANDIBLE,
    MUSCLE,
    NOTHING,
    PIECES,
    PRESETS,
    SKULL,
    SOFT,
    UPPER,
    UPPER_TEETH,
    Preset,
)
from pinnochio.importing.segment_files import Segment, check_extent, read_segments, read_surfaces
from pinnochio.importing.segmentation import HEADER, axes_of, labelled_extent
from pinnochio.importing.soft_tissue import (
    air_threshold,
    between,
    bulk,
    check_belongs,
    closed,
    hollows,
    near_skin,
    without_padding,
)
from pinnochio.model.labels import CRANIUM, SUPERFICIAL, TOUCHING, segment_code
from pinnochio.volume_size import IMAGE_FORMATS

LOG = logging.getLogger(__name__)
VOXEL = 1.0  # mm: finer voxels are merged, elements are several times as large
THIN = 0.4  # share of a merged voxel from which bone counts: plates of half a voxel stay [I]
OPENING, APERTURE, DEPTH = 3.0, 10.0, 28.0  # mm
LOOSE, COMPARABLE = 0.02, 0.2  # of the largest piece: a skull may be in pieces; a piece that is no crumb [I]
ISLAND = 25.0  # mm between teeth of one arch, at most: what lies farther off is none [I]
SMALLEST_HEAD = 0.3  # of the volume of the bones: less soft tissue is no face [I]
ABOUT = 100.0  # mm round what is labelled that is taken of the scan: skin, and the air before it [I]
# Which part wins where two claim a voxel.
RANK = {UPPER_TEETH: 8, LOWER_TEETH: 8, CANAL: 4, SKULL: 4, MANDIBLE: 4, MUSCLE: 2, NOTHING: 1, SOFT: 0.4, HEAD: 0.2}
RANK |= dict.fromkeys(PIECES.values(), 7.9)  # over bone where half of a voxel is theirs, not over teeth
NOUN = {SKULL: "skull", MANDIBLE: "mandible"}
PARTED = "name each surface for what it shows: skull, mandible, upper_teeth, lower_teeth, skin, or a piece such as "
PARTED += "lefort1; part one of all bones first (loose parts in Blender, islands in 3D Slicer's Segment Editor)"


@dataclass(frozen=True)
class HeadParts:
    """parts (nx, ny, nz) uint8 of :mod:`presets` [ix, iy, iz], 0 air; spacing, origin (3,) mm, LPS; axes of the file.

    soft: where the soft tissue comes from, in words; sided: whether structures that tell left from right are labelled;
    pieces: of PIECES, 0 elsewhere; closed: planes that close openings of surfaces, by structure.
    """

    parts: np.ndarray
    spacing: np.ndarray
    origin: np.ndarray
    axes: str
    soft: str
    sided: bool = False
    pieces: np.ndarray | None = None
    closed: Mapping[str, Sequence[dict]] = field(default_factory=dict)

    def piece(self, name: str) -> np.ndarray | None:
        """Voxels of a piece that is cut already (of PIECES), None where nobody has cut it."""
        mask = None if self.pieces is None else self.pieces == PIECES[name]
        return mask if mask is not None and mask.any() else None

    def uncut(self) -> np.ndarray:
        """Internal codes of the head before any cut, with the mandible as the only segment."""
        labels = np.zeros(self.parts.shape, np.uint8)
        for codes, code in (((SOFT,), SUPERFICIAL), (UPPER, CRANIUM), (LOWER, segment_code(0))):
            labels[np.isin(self.parts, codes)] = code
        return labels


def read_head_parts(
    path: str | os.PathLike,
    volume: str | os.PathLike | None,
    case: str,
    preset: str,
    orientation: str = HEADER,
    regions: Sequence[tuple[np.ndarray, np.ndarray]] = (),
    loose_percent: float = 100.0,
) -> HeadParts:
    """The parts of a head from the tool's file, or folder of files, and the scan itself (None: not needed).

    A file of a folder is a label map of the kind that its name tells, or one structure that its name is, a surface too.
    Cubes of VOXEL mm, or the finest edge of the file. regions: boxes (low, high) mm outside of which nothing is kept.
    Soft tissue: what the tool labels as inside the skin; without that, what is no air in the volume (Otsu). Of it is
    kept what is DEPTH mm from the skin at most: neither brain nor throat nor tongue. Bone that hangs on nothing is
    dropped, up to loose_percent of skull or mandible. Raises InputError.
    """
    refuse = refusal(case, path)
    values, grid, axes, sided, closed_by = _read_parts(path, preset, orientation, regions, refuse)
    scan = read_scan(volume, orientation, case, refuse) if volume else None
    if scan:  # labels may be cropped to the bones: the skin lies beyond
        wide = [*regions, _about(values, grid)]
        grid, values, _ = _grown(grid, values, np.zeros_like(values), scan, wide, partial(refuse, file=volume))
    pieces, values, spacing = values * (values > NOTHING), BONE_OF[values], grid.GetSpacing()[0]
    _tidy_bones(values, spacing, case)
    _drop_loose(values, loose_percent, refuse)
    bone = np.isin(values, (*UPPER, *LOWER))
    head, source = _head(values, bone, scan, volume, grid, case, refuse)
    values = _with_soft(values, bone, head, spacing, case, volume or path)
    return HeadParts(values, np.full(3, spacing), np.array(grid.GetOrigin()), axes, source, sided, pieces, closed_by)


def _tidy_bones(values, spacing: float, case: str) -> None:
    """Turn islands that are called teeth, far from the arch, into the bone that holds it; fill what a bone encloses."""
    for teeth, jaw in ((UPPER_TEETH, SKULL), (LOWER_TEETH, MANDIBLE)):
        mask = values == teeth
        if mask.any():
            # Teeth of one arch may stand apart, each within reach of the next.
            pieces, _ = ndimage.label(ndimage.distance_transform_edt(~mask, spacing) <= ISLAND / 2)
            island = mask & (pieces != np.bincount(pieces[mask]).argmax())
            if island.any():
                volume = island.sum() * spacing**3 / 1000
                LOG.warning(
                    "case %r: %.2f cm3 that are called teeth lie far from the dental arch; taken as bone", case, volume
                )
                values[island] = jaw
    for codes, jaw in ((UPPER, SKULL), (LOWER, MANDIBLE)):
        bone = np.isin(values, codes)
        values[hollows(bone, spacing**3) & (values == 0)] = jaw


def _drop_loose(values, limit: float, refuse) -> None:
    """Turn loose pieces of the bones into air; refuse a mandible in two, and more than `limit` percent of a bone."""
    level = {part: np.argwhere(values == part)[:, 2].mean() for part in (*UPPER, *LOWER) if (values == part).any()}
    if {UPPER_TEETH, LOWER_TEETH} <= level.keys():
        over = level[UPPER_TEETH] > level[LOWER_TEETH]
        if over != (level[SKULL] > level[MANDIBLE]):
            refuse("the upper teeth lie below the lower teeth, as the bones do not", "exchange their values")
    for name, codes in (("skull", UPPER), ("mandible", LOWER)):
        bone = np.isin(values, codes)
        pieces, _ = ndimage.label(bone, TOUCHING)
        size = np.bincount(pieces.ravel())
        size[0] = 0
        order = np.sort(size)[::-1]
        if name == "mandible" and len(order) > 2 and order[1] > COMPARABLE * order[0]:
            refuse(
                f"the mandible is in pieces of {order[0]} and {order[1]} voxels",
                "join them in the segmentation; what is not mandible (hyoid, vertebra) must not be labelled so",
            )
        loose = (size < (order[0] if name == "mandible" else LOOSE * order[0]))[pieces] & bone
        if 100 * loose.sum() > limit * bone.sum():
            share = 100 * loose.sum() / bone.sum()
            problem = f"stray voxels and loose pieces make up {share:.3g} % of the {name} (the limit is {limit:g} %)"
            refuse(problem, "clean it in the segmentation (islands: keep the largest), or raise 'repair.limit'")
        values[loose] = 0


def _read_parts(path, preset: str, orientation: str, regions, refuse):
    """Parts [ix, iy, iz] on the grid, the grid, the axes of the file, whether labels tell left from right, and what
    closes surfaces."""
    tool = PRESETS[preset]
    direction = None if orientation == HEADER else axes_of(orientation)
    grid, values, weight, centre = None, None, None, {}
    axes, closed_by = "LPS", {}
    for file, image, pieces in _structures(path, tool, refuse, direction):
        if file.is_file():
            face(image, direction, partial(refuse, file=file))
        if grid is None:
            axes = sitk.DICOMOrientImageFilter.GetOrientationFromDirectionCosines(image.GetDirection())
        grid, values, weight = _grown(grid, values, weight, image, regions, refuse)
        for name, segment in pieces:
            closed_by |= {name: segment.closed} if segment.closed else {}
            share = _resampled(_on(image, segment.voxels()), grid)
            across = share.sum(axis=(1, 2))
            if across.any():
                x = grid.GetOrigin()[0] + grid.GetSpacing()[0] * np.arange(len(across))
                centre[name] = float(across @ x / across.sum())
            part = tool.all_parts[name]
            share = share / THIN if BONE_OF[part] in (*UPPER, *LOWER) else share / 0.5
            # Teeth over bone, bone over muscle, muscle over what fills the head, each where it is at least half there.
            better = (share >= 1) & (share * RANK[part] > weight)
            values[better], weight[better] = part, (share * RANK[part])[better]
    if grid is None:
        refuse("every voxel of it is 0", "save the label maps with the values that the tool writes")
    check_extent(labelled_extent(values > 0, grid.GetSpacing()), refuse)
    for part, name in NOUN.items():
        if not (BONE_OF[values] == part).any():
            refuse(
                f"no {name} is labelled; it holds {', '.join(centre) or 'nothing'}",
                PARTED if surfaces_in(path) else f"check that it is what {preset!r} writes, or choose another preset",
            )
    pairs = [pair for pair in tool.sides if set(pair) <= centre.keys()]
    wrong = [pair for pair in pairs if centre[pair[0]] < centre[pair[1]]]
    if len(wrong) > len(pairs) / 2:
        problem = f"left and right are exchanged: {wrong[0][0]!r} lies to the right of {wrong[0][1]!r}"
        refuse(problem, "correct the header, or set 'orientation' to where the voxel axes really point")
    return values, grid, axes, bool(pairs), closed_by


def bone_parts(path: str | os.PathLike, preset: str, refuse) -> Iterator[tuple[sitk.Image, np.ndarray]]:
    """Grid and bone (bool [iz, iy, ix]) of each file of a tool."""
    tool = PRESETS[preset]
    for _, image, pieces in _structures(path, tool, refuse):
        masks = [part.voxels() for name, part in pieces if BONE_OF[tool.all_parts[name]] in (*UPPER, *LOWER)]
        if masks:
            yield image, np.logical_or.reduce(masks)


def _structures(path, tool: Preset, refuse, direction=None) -> Iterator[tuple[Path, sitk.Image, list]]:
    """Of each file, and of all surfaces of a folder, the grid and the structures: name and segment.

    direction: of the axes of surfaces, as of :func:`read_surfaces`.
    """
    path = Path(path)
    files = [path]
    if path.is_dir():
        files = [file for file in entries(path) if file.name.lower().endswith(IMAGE_FORMATS)]
        if surfaces_in(path, refuse) or not files:
            files.append(path)
    sources: dict[str, Path] = {}
    for file in files:
        refuse_file = partial(refuse, file=file)
        stem = file.name.split(".")[0]
        kinds = [kind for kind in tool.maps if kind in stem.lower()]
        if file.is_dir():  # beside a label map there is no more than the surfaces
            image, segments = read_surfaces(file, direction, refuse, len(files) == 1)
            if strange := [segment.name for segment in segments if tool.structure(segment.name) is None]:
                refuse(f"nothing says what the surface {strange[0]!r} is", PARTED)
        else:
            image, segments = read_segments(file, refuse_file, may_be_empty=path.is_dir())
        if not segments:  # as of what a tool looks for and does not find
            continue
        called = _by_name(segments, tool, refuse_file)
        if called:
            pieces = called
        elif name := tool.structure(stem):
            if len(segments) > 1:
                refuse_file(
                    f"it holds {len(segments)} values, and its name is that of one structure",
                    "save a mask of zeros and ones, not a probability",
                )
            pieces = [(name, segments[0])]
        elif file.is_file() and (len(kinds) == 1 or len(files) == 1):
            names = tool.maps[kinds[0] if len(kinds) == 1 else next(iter(tool.maps))]
            strange = [str(segment) for segment in segments if segment.value not in names]
            if strange:
                refuse_file(
                    f"it holds the values {', '.join(strange)}, which the tool does not write",
                    f"check that it is the tool's own label map: {len(names)} values from 1 on; or write down what its "
                    "values mean in 'labels'",
                )
            pieces = [(names[segment.value], segment) for segment in segments]
            if strange := [str(segment) for segment in segments if segment.name and not tool.structure(segment.name)]:
                said = ", ".join(f"{segment} as {name}" for name, segment in pieces)
                LOG.warning("%s: the tool knows no %s; taken by value: %s", file, ", ".join(strange), said)
        else:
            listed = ", ".join(kind for kind in tool.maps if kind) or "the one label map"
            refuse_file(
                f"nothing says what {file.name!r} is",
                f"name label maps by their kind ({listed}) and files of one structure by the tool's name for it, such "
                f"as {next(iter(tool.parts))!r}",
            )
        for name, _ in pieces:
            if name in sources:
                refuse_file(f"{name!r} is in {sources[name].name!r} too", "keep one file of each structure")
            sources[name] = file
        yield file, image, pieces


def _by_name(segments: Sequence[Segment], tool: Preset, refuse) -> list:
    """Structures of segments that bear the tool's names, which then count, whatever their values are; none
    where no name is known, or where those that are agree with their values, as beside a segment that was added."""
    called = [tool.structure(segment.name) for segment in segments if segment.name]
    if called and all(called):
        return list(zip(called, segments, strict=True))
    for name, segment in zip(called, segments, strict=False):
        if name and all(values.get(segment.value) != name for values in tool.maps.values()):
            strange = segments[called.index(None)]
            problem = f"the value of {segment} is not the tool's for that name, and {strange} bears no name of the tool"
            refuse(problem, "give each segment the tool's name, or the tool's value")
    return []


def _on(image: sitk.Image, voxels) -> sitk.Image:
    made = sitk.GetImageFromArray(np.ascontiguousarray(voxels, np.float32))
    made.CopyInformation(image)
    return made


def _grown(grid, values, weight, image: sitk.Image, regions, refuse) -> tuple[sitk.Image, np.ndarray, np.ndarray]:
    """Cubes along the axes of LPS that hold the image, or what the regions keep of it, and the grid so far (its voxels
    mean nothing), with values and weights where they were; the edge is the first file's."""
    size, spacing = np.array(image.GetSize()), np.array(image.GetSpacing())
    if grid is None:
        check_extent(float((size * spacing).max()) if (size * spacing).max() < 20 else None, refuse)
    edge = float(max(VOXEL, spacing.min())) if grid is None else grid.GetSpacing()[0]
    corners = np.array(np.meshgrid(*[(-0.5, n - 0.5) for n in size], indexing="ij")).reshape(3, -1).T.tolist()
    places = np.array([image.TransformContinuousIndexToPhysicalPoint(corner) for corner in corners])
    low, high = places.min(axis=0), places.max(axis=0)
    for start, end in regions:
        low, high = np.maximum(low, start), np.minimum(high, end)
    if regions and (high - low < 10 * edge).any():
        remedy = "correct the region (ROI) of the markups, or the frame of the scan"
        refuse("hardly anything of it lies in the region of interest", remedy)
    if grid is not None:
        start = np.array(grid.GetOrigin()) - edge / 2
        before = np.maximum(0, np.ceil((start - low) / edge - 1e-3)).astype(int)
        low = start - edge * before
        high = np.maximum(high, start + edge * np.array(values.shape))
    count = np.floor((high - low) / edge + 1e-6).astype(int)
    if count.prod() > 3e8:
        refuse(f"it measures {np.round(high - low).astype(int).tolist()} mm", "write the voxel spacing in millimetres")
    if grid is not None and (count == values.shape).all():
        return grid, values, weight
    made = np.zeros(count, np.uint8), np.zeros(count, np.float32)
    if grid is not None:
        place = tuple(slice(b, b + n) for b, n in zip(before, values.shape, strict=True))
        made[0][place], made[1][place] = values, weight
    grid = sitk.Image(count.tolist(), sitk.sitkUInt8)
    grid.SetSpacing([edge] * 3)
    grid.SetOrigin((low + edge / 2).tolist())
    return grid, *made


def _about(values, grid) -> tuple[np.ndarray, np.ndarray]:
    """The box (low, high) mm that is ABOUT wider than what is labelled."""
    box = ndimage.find_objects((values > 0).astype(np.uint8))[0]
    ends = np.array([(side.start, side.stop) for side in box]).T * grid.GetSpacing()[0] + grid.GetOrigin()
    return ends[0] - ABOUT, ends[1] + ABOUT


def _resampled(image: sitk.Image, grid: sitk.Image, outside: float = 0.0) -> np.ndarray:
    """Values [ix, iy, iz] on the grid: means over its voxels where the image is finer, linear between where not."""
    edge, spacing = grid.GetSpacing()[0], np.array(image.GetSpacing())
    if (factors := np.maximum(1, np.round(edge / spacing + 1e-6)).astype(int)).max() > 1:
        image = sitk.BinShrink(image, factors.tolist())
    made = sitk.Resample(image, grid, sitk.Transform(), sitk.sitkLinear, outside)
    return sitk.GetArrayFromImage(made).transpose(2, 1, 0)


def read_scan(volume, orientation: str, case: str, refuse) -> sitk.Image:
    """The scan that a file or a folder of DICOM holds, float32, with air where it shows nothing; orientation as of
    :func:`read_head_parts`. Refused where it cannot be read or holds what is no number."""
    refuse_scan = partial(refuse, file=volume)
    image = read_volume(volume, refuse_scan, sitk.sitkFloat32)
    face(image, None if orientation == HEADER else axes_of(orientation), refuse_scan)
    if not np.isfinite(sitk.GetArrayViewFromImage(image)).all():
        refuse_scan("it holds NaN or infinite voxels", "replace them by the value of air")
    image, padding = without_padding(image)
    if padding is not None:
        LOG.warning("case %r: %s: %g fills what the scan does not show; ignored", case, volume, padding)
    return image


def _head(values, bone, scan, volume, grid, case: str, refuse) -> tuple[np.ndarray, str]:
    """All that is not air (nx, ny, nz) bool, and where that comes from."""
    labelled, spacing = np.isin(values, (SOFT, HEAD)), grid.GetSpacing()[0]
    if scan is None:
        if not labelled.any():
            problem = "the tool labels no soft tissue, and there is no scan to take it from"
            refuse(problem, "put the CT or cone-beam CT beside it (volume.nii.gz; column 'volume' of a table)")
        return labelled | bone | (values == MUSCLE), "labelled"
    grey = _resampled(scan, grid, float(sitk.GetArrayViewFromImage(scan).min()))
    check_belongs(grey, bone, spacing, partial(refuse, file=volume))
    threshold = air_threshold(grey, bone)
    LOG.info("case %r: air and tissue part at the grey value %.0f of %s", case, threshold, volume)
    tissue = bulk((grey > threshold) | bone, OPENING / spacing) | bone
    if labelled.any():
        tissue &= labelled | bone | (values == MUSCLE)
    return tissue, f"the scan, above the grey value {threshold:.0f} (Otsu)"


def _with_soft(values, bone, head, spacing: float, case: str, file) -> np.ndarray:
    """The parts with the soft tissue of a face; what lies deeper, and between the dental arches, is left out."""
    upper, lower = np.isin(values, UPPER), np.isin(values, LOWER)
    teeth = np.isin(values, (UPPER_TEETH, LOWER_TEETH))
    index = np.argwhere(teeth if teeth.any() else lower)
    low, high = index.min(axis=0), index.max(axis=0)
    arches = upper | lower
    if teeth.any():  # in front of the last molars: not what lies between the rami
        arches[:, high[1] + 1 :] = False
        arches[:, :, : low[2]] = False
        arches[:, :, high[2] + 1 :] = False
    else:
        arches &= lower
    oral = between(closed(arches, APERTURE / spacing)) & ~bone
    soft = head & ~bone & ~oral & (values != NOTHING)
    kept = near_skin(head, soft, spacing, DEPTH, APERTURE, refusal(case, file))
    muscle = (values == MUSCLE) & kept
    made = np.where(bone, values, 0).astype(np.uint8)
    made[kept] = SOFT
    made[muscle] = MUSCLE
    if kept.sum() < SMALLEST_HEAD * bone.sum():
        tissue, bony = (mask.sum() * spacing**3 / 1000 for mask in (kept, bone))
        problem = f"only {tissue:.0f} cm3 of soft tissue lie round {bony:.0f} cm3 of bone"
        raise InputError(case, file, problem, "check the scan and its frame: the skin must be in the field of view")
    return made
