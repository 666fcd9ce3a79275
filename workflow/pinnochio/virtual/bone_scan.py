"""The bones of a virtual patient in a scan after surgery: noisy, with plates, callus, streaks and parts cut away.

What a segmentation of such a scan (cone-beam CT, some months after surgery) hands over: a label map of bone, with one
or two labels, not one per segment, in the scanner's own frame.
"""

from dataclasses import dataclass
from itertools import combinations

import numpy as np
from scipy import ndimage
from scipy.spatial.transform import Rotation

from pinnochio.geometry.rigid import RigidMotion
from pinnochio.importing.segmentation import Segmentation
from pinnochio.model.labels import AIR, CRANIUM, segment_code
from pinnochio.plans.plan import Plan
from pinnochio.plans.roles import known_role

SPACING = (0.8, 1.0)  # mm, voxel edge; cone-beam voxels of 0.3-0.4 mm [R] resampled for the segmentation [I]
ANGLE, SHIFT = 10.0, 25.0  # degrees and mm per axis by which the scanner's frame is off at most [I]
NOISE, CORRELATION = 0.25, 1.0  # mm, SD of the surface along its normal; voxels, the Gaussian that makes it smooth [I]
ROUNDING = 0.7  # voxels: takes the steps of the labels before surgery off
TOP_CUT = (2.0, 15.0)  # mm of the forehead that the field of view lacks [I]
REAR_CUT, REAR_CHANCE = (4.0, 14.0), 0.3  # mm of joints and rami that it lacks, in this share of the patients [I]
PLATES = (2, 4)  # per pair of bones that were cut apart; two to four miniplates each [R]
# mm: miniplates are 1 mm thick, screw heads 3-4 mm wide [R], and metal blooms [I]
PLATE_RADIUS, SCREW_RADIUS = 1.1, 1.9
PLATE_REACH = (4.0, 8.0)  # mm from the cut to a screw [R]
CALLUS = 2.5  # mm; narrower gaps are partly filled [I]
# Bars of bright or dark from metal in teeth: how many, mm [I].
STREAKS, STREAK_LENGTH, STREAK_RADIUS = (3, 7), (15.0, 35.0), (0.5, 1.1)
MARGIN = 4.0  # mm around a bone within which its distance is known, and around all of them in the volume
FAR = np.float32(MARGIN)


@dataclass(frozen=True)
class BoneScan:
    """labels (nx, ny, nz) uint8, 0 where there is no bone; spacing, origin (3,) mm; frame: patient -> scanner."""

    labels: np.ndarray
    spacing: np.ndarray
    origin: np.ndarray
    frame: RigidMotion


class ScannerVolume:
    """The scanner's voxels: distance to the nearest bone and to the next one (mm, negative inside), and which it is."""

    def __init__(self, low: np.ndarray, high: np.ndarray, spacing: float, frame: RigidMotion):
        self.low, self.spacing, self.frame = low, spacing, frame
        shape = np.maximum(np.ceil((high - low) / spacing).astype(int) + 1, 2)
        self.nearest, self.second = np.full(shape, FAR), np.full(shape, FAR)
        self.owner = np.zeros(shape, np.int8)

    def block(self, low, high) -> tuple[tuple[slice, ...], np.ndarray]:
        """Index of the voxels within a box of the scanner's frame, and their centres (n, 3) mm."""
        start = np.clip(np.floor((low - self.low) / self.spacing).astype(int), 0, self.nearest.shape)
        stop = np.clip(np.ceil((high - self.low) / self.spacing).astype(int) + 1, 0, self.nearest.shape)
        index = tuple(map(slice, start, np.maximum(start, stop)))
        axes = [self.low[i] + self.spacing * np.arange(index[i].start, index[i].stop) for i in range(3)]
        return index, np.stack(np.meshgrid(*axes, indexing="ij"), -1).reshape(-1, 3)

    def add_bone(self, owner: int, distance: np.ndarray, start: np.ndarray, step: np.ndarray, motion: RigidMotion):
        """A bone by its distance field before surgery (first voxel's centre `start`, voxel edges `step`), moved."""
        moved = self.frame.apply(motion.apply(_corners(start, start + step * distance.shape)))
        index, places = self.block(moved.min(axis=0), moved.max(axis=0))
        before = motion.inverse(self.frame.inverse(places))
        placed = ndimage.map_coordinates(distance, ((before - start) / step).T, order=1, mode="constant", cval=FAR)
        placed = placed.reshape([s.stop - s.start for s in index]).astype(np.float32)
        nearer = placed < self.nearest[index]
        self.second[index] = np.where(nearer, self.nearest[index], np.minimum(self.second[index], placed))
        self.owner[index] = np.where(nearer, owner, self.owner[index])
        self.nearest[index] = np.minimum(self.nearest[index], placed)

    def bar(self, one: np.ndarray, other: np.ndarray, radius: float, sign: float = 1.0) -> None:
        """Bone-like material (sign 1) or its lack (-1) within `radius` mm of the line between two points."""
        index, places = self.block(np.minimum(one, other) - radius - 1, np.maximum(one, other) + radius + 1)
        along = other - one
        share = np.clip((places - one) @ along / max(along @ along, 1e-9), 0, 1)
        gap = np.linalg.norm(places - one - share[:, None] * along, axis=1) - radius
        gap = gap.reshape([s.stop - s.start for s in index]).astype(np.float32)
        here = self.nearest[index]
        self.nearest[index] = np.minimum(here, gap) if sign > 0 else np.maximum(here, -gap)


def _corners(low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """The eight corners (8, 3) of a box."""
    return np.array(np.meshgrid(*zip(low, high, strict=True))).reshape(3, -1).T


def distance_field(inside: np.ndarray, spacing: np.ndarray) -> np.ndarray:
    """Signed distance (mm, negative inside) from the border of a voxel set, smoothed over its steps."""
    half = 0.5 * float(np.min(spacing))
    outer = ndimage.distance_transform_edt(~inside, spacing) - half
    inner = ndimage.distance_transform_edt(inside, spacing) - half
    return ndimage.gaussian_filter(np.where(inside, -inner, outer).astype(np.float32), ROUNDING)


def exposed(labels: np.ndarray, code: int, beside: np.ndarray) -> np.ndarray:
    """Voxels (n, 3) of a label that share a face with a voxel of `beside`."""
    return np.argwhere((labels == code) & ndimage.binary_dilation(beside))


def plate_sites(head: Segmentation, one: int, other: int, count: int, rng) -> list[tuple[np.ndarray, np.ndarray]]:
    """Screws (patient's mm, before surgery) of plates over the cut between two bones, by their codes: one in each."""
    labels, reach = head.labels, PLATE_REACH[1] + 2
    both = ndimage.find_objects(((labels == one) | (labels == other)).astype(np.uint8))[0]
    labels = labels[both]
    start = head.origin + head.spacing * [part.start for part in both]
    soft = (labels != AIR) & (labels < CRANIUM)
    sides = []
    for code, opposite in ((one, other), (other, one)):
        if not (labels == code).any() or not (labels == opposite).any():
            return []
        surface = exposed(labels, code, soft)
        away = ndimage.distance_transform_edt(labels != opposite, head.spacing)[tuple(surface.T)]
        sides.append((surface * head.spacing + start, away))
    cut = sides[0][0][sides[0][1] <= 2 * head.spacing.max()]
    sites = []
    for _ in range(count if len(cut) else 0):
        site = cut[rng.integers(len(cut))]
        cut = cut[np.linalg.norm(cut - site, axis=1) > 2 * reach]
        ends = []
        for points, away in sides:
            near = (away > PLATE_REACH[0]) & (away < PLATE_REACH[1])
            near &= np.linalg.norm(points - site, axis=1) < reach
            if near.any():
                ends.append(points[near][rng.integers(near.sum())])
        if len(ends) == 2:
            sites.append((ends[0], ends[1]))
        if not len(cut):
            break
    return sites


def scan_bones(head: Segmentation, executed: Plan, rng: np.random.Generator, artefacts: float = 1.0) -> BoneScan:
    """The bones after surgery as a label map.

    head: the segmentation before surgery, internal codes; executed: the motions that the segments were given;
    artefacts: multiple of noise and of the material that metal, callus and streaks add or take, 0 for a clean scan of
    all that the segmentation shows; the frame is the scanner's own in any case. Of two labels 1 is the skull with the
    upper jaw, 2 the lower jaw.
    """
    draws = [np.random.default_rng(seed) for seed in rng.integers(2**63, size=6)]
    codes = {CRANIUM: RigidMotion()}
    codes |= {segment_code(i): executed.motion(name) for i, name in enumerate(head.segments)}
    codes = {code: motion for code, motion in codes.items() if (head.labels == code).any()}
    frame = _frame(draws[0], head)
    spacing = draws[0].uniform(*SPACING)
    boxes = ndimage.find_objects(head.labels)
    starts = {code: head.origin + head.spacing * [part.start for part in boxes[code - 1]] for code in codes}
    shown = np.concatenate(
        [
            frame.apply(motion.apply(np.argwhere(head.labels == code)[::5] * head.spacing + head.origin))
            for code, motion in codes.items()
        ]
    )
    low, high = shown.min(axis=0) - MARGIN, shown.max(axis=0) + MARGIN
    if artefacts:
        low, high = _seen(draws[1], low, high)
    volume = ScannerVolume(low, high, spacing, frame)
    pad = int(np.ceil(MARGIN / head.spacing.min())) + 1
    for code, motion in codes.items():
        inside = np.pad(head.labels[boxes[code - 1]] == code, pad)
        start = starts[code] - pad * head.spacing
        volume.add_bone(code, distance_field(inside, head.spacing), start, head.spacing, motion)
    if artefacts:
        noise = _smooth_noise(draws[2], volume.nearest.shape, CORRELATION)
        gap = (volume.nearest > 0) & (volume.nearest + volume.second < artefacts * CALLUS)
        volume.nearest[gap & (_smooth_noise(draws[3], gap.shape, 2 / spacing) > 0)] = -0.5
        _add_metal(volume, head, codes, draws[4], artefacts)
        _add_streaks(volume, head, codes, draws[5], artefacts)
        volume.nearest += np.float32(artefacts * NOISE) * noise
    lower = [segment_code(i) for i, name in enumerate(head.segments) if known_role(name) != "maxilla"]
    labels = (volume.nearest < 0).astype(np.uint8)
    if draws[0].random() < 2 / 3:
        labels[(labels > 0) & np.isin(volume.owner, lower)] = 2
    return BoneScan(labels, np.full(3, spacing), low, frame)


def _frame(rng: np.random.Generator, head: Segmentation) -> RigidMotion:
    """From the patient's frame to the scanner's."""
    axis = rng.normal(size=3)
    turn = Rotation.from_rotvec(axis / np.linalg.norm(axis) * rng.uniform(0.2, 1) * ANGLE, degrees=True)
    centre = head.origin + head.spacing * np.array(head.labels.shape) / 2
    return RigidMotion(turn.as_matrix(), rng.uniform(-SHIFT, SHIFT, 3), centre)


def _seen(rng: np.random.Generator, low: np.ndarray, high: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The field of view: less of the forehead, and of some patients less of the joints."""
    top, chance, rear = rng.uniform(*TOP_CUT), rng.random(), rng.uniform(*REAR_CUT)
    return low, high - [0, MARGIN + rear if chance < REAR_CHANCE else 0, MARGIN + top]


def _smooth_noise(rng: np.random.Generator, shape: tuple[int, ...], sigma: float) -> np.ndarray:
    """Gaussian field of unit variance, float32, white noise under a Gaussian of sigma voxels."""
    field = ndimage.gaussian_filter(rng.standard_normal(shape, np.float32), sigma, mode="wrap")
    return field / field.std()


def _add_metal(volume: ScannerVolume, head: Segmentation, codes: dict[int, RigidMotion], rng, artefacts: float) -> None:
    """Plates with screws over every cut; each end goes with its bone."""
    for one, other in combinations(codes, 2):
        for ends in plate_sites(head, one, other, int(rng.integers(*PLATES, endpoint=True)), rng):
            placed = [
                volume.frame.apply(codes[code].apply(end[None]))[0]
                for code, end in zip((one, other), ends, strict=True)
            ]
            volume.bar(*placed, artefacts * PLATE_RADIUS)
            for end in placed:
                volume.bar(end, end, artefacts * SCREW_RADIUS)


def _add_streaks(
    volume: ScannerVolume, head: Segmentation, codes: dict[int, RigidMotion], rng, artefacts: float
) -> None:
    """Bars, bright or dark, in the scanner's axial planes from bone that borders on the air of the mouth: teeth."""
    teeth = [
        (code, voxels)
        for code in codes
        if code != CRANIUM and len(voxels := exposed(head.labels, code, head.labels == AIR))
    ]
    for _ in range(int(rng.integers(*STREAKS, endpoint=True)) if teeth else 0):
        code, voxels = teeth[rng.integers(len(teeth))]
        place = codes[code].apply((voxels[rng.integers(len(voxels))] * head.spacing + head.origin)[None])
        start, angle = volume.frame.apply(place)[0], rng.uniform(0, 2 * np.pi)
        end = start + rng.uniform(*STREAK_LENGTH) * np.array([np.cos(angle), np.sin(angle), 0])
        volume.bar(start, end, artefacts * rng.uniform(*STREAK_RADIUS), rng.choice([-1.0, 1.0]))
