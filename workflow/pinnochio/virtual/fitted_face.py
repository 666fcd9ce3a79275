"""Fits a face of the model of scanned persons round a skull of which no skin is known, and scans it.

For trying import, mesh and mechanics on real bones: the soft tissue is a likely one, not the patient's.
"""

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from pinnochio.geometry.triangles import vertex_normals
from pinnochio.importing.presets import LOWER_TEETH, UPPER_TEETH
from pinnochio.virtual.morphable_model import ModelFace, face_model, face_solid, make_face

STEPS = 25
THICKNESS = 5.0  # mm of soft tissue over bone at least: less than most published means [I]
CLOSE = 11.0  # mm: skin this far from the foremost bone is pulled no nearer [I]
ANCHOR, DEPTH, PULL, LIKELY = 2.0, 1.0, 0.15, 2.0  # weights: teeth, bone under the skin, skin near bone, likely face
SLIT = 1.0  # mm: half the height of the slit between the lips


@dataclass(frozen=True)
class FittedFace:
    """face in its own frame; rotation (3, 3), shift (3,) mm bring it to the patient; covered: share of bone inside."""

    face: ModelFace
    rotation: np.ndarray
    shift: np.ndarray
    covered: float


def fit_face(bone, teeth: dict[int, np.ndarray]) -> FittedFace:
    """Face whose teeth lie on those of a skull and whose skin covers its bone.

    bone (b, 3) mm, LPS: surface points of the front of the skull; teeth: voxels (t, 3) mm of UPPER_TEETH and
    LOWER_TEETH. Gauss-Newton over the pose and the modes: incisors and last molars on each other; bone nearer to the
    skin than THICKNESS, or outside, pushes it; skin that lies farther off is pulled weakly; likely faces are preferred.
    """
    model = face_model()
    rows = {UPPER_TEETH: model.teeth["upper_teeth"], LOWER_TEETH: model.teeth["lower_teeth"]}
    wanted = np.concatenate([_three(teeth[part]) for part in rows])
    picks = np.concatenate([row[[[0], [15], [7]]].ravel() for row in rows.values()])
    skin = np.unique(model.triangles)
    coordinates = np.zeros(len(model.modes))
    rotation, shift = _aligned(model.mean[picks], wanted)
    weight = 1.0
    for _ in range(STEPS):
        points = model.mean + np.einsum("k,knx->nx", coordinates, model.modes)
        normals = vertex_normals(points, model.triangles)
        local = (bone - shift) @ rotation  # the bone in the face's frame
        near = skin[cKDTree(points[skin]).query(local)[1]]
        inward = -np.einsum("ij,ij->i", local - points[near], normals[near])
        low, far = inward < THICKNESS, inward > CLOSE
        weight = np.where(low, DEPTH, np.where(far, PULL, 0.0)) / np.sqrt(len(local) / 300)
        target = np.where(low, THICKNESS, CLOSE) - inward
        anchors = (wanted - shift) @ rotation - points[picks]
        # Columns: modes, then turn and shift of the face in its own frame.
        place = np.concatenate([points[near], points[picks]])
        modes = np.concatenate([model.modes[:, near], model.modes[:, picks]], axis=1)
        rigid = np.concatenate(
            [np.cross(np.eye(3)[:, None], place[None]), np.repeat(np.eye(3)[:, None], len(place), 1)]
        )
        every = np.concatenate([modes, rigid])
        count = len(near)
        by_depth = np.einsum("kix,ix->ik", every[:, :count], normals[near]) * weight[:, None]
        by_anchor = np.moveaxis(every[:, count:], 0, 2).reshape(-1, len(every)) * ANCHOR
        prior = LIKELY * np.eye(len(coordinates), len(every))
        left = np.concatenate([by_depth, by_anchor, prior])
        right = np.concatenate([target * weight, (anchors * ANCHOR).ravel(), -LIKELY * coordinates])
        step = np.linalg.lstsq(left, right, rcond=None)[0] * 0.7
        coordinates = np.clip(coordinates + step[:-6], -3, 3)
        turn = Rotation.from_rotvec(step[-6:-3]).as_matrix()
        shift = shift + rotation @ step[-3:]
        rotation = rotation @ turn
    face = make_face(coordinates)
    # make_face puts its own tragi at y = 0.
    moved = (model.mean + np.einsum("k,knx->nx", coordinates, model.modes) - face.points)[0]
    shift = shift + rotation @ moved
    return FittedFace(face, rotation, shift, float((inward > 0).mean()))


def scan_of(fitted: FittedFace, bone, grid_low, spacing: float) -> np.ndarray:
    """Grey values (nx, ny, nz) as of a CT: air -1000, tissue 40, bone 900; lips apart by a slit.

    bone (nx, ny, nz) bool on a grid of cubes whose first voxel lies at grid_low (3,) mm, LPS.
    """
    index = np.stack(np.indices(bone.shape), axis=-1).reshape(-1, 3) * spacing + grid_low
    local = (index - fitted.shift) @ fitted.rotation
    low, high = local.min(axis=0) - spacing, local.max(axis=0) + spacing
    axes = [np.arange(a, b, spacing) for a, b in zip(low, high, strict=True)]
    axes[1] = np.arange(min(low[1], fitted.face.points[:, 1].min() - 5), high[1], spacing)
    inside = face_solid(fitted.face, axes)
    # The skin of the model ends behind the ears; from there the head goes on as it is.
    last = min(len(axes[1]) - 1, int(np.searchsorted(axes[1], 0.0)))
    inside[:, last:] = inside[:, last : last + 1]
    cell = np.rint((local - [axis[0] for axis in axes]) / spacing).astype(int)
    head = inside[tuple(np.clip(cell, 0, np.array(inside.shape) - 1).T)]
    line = fitted.face.line
    middle = np.interp(local[:, 0], line[:, 0], line[:, 2])
    front = np.interp(local[:, 0], line[:, 0], line[:, 1])
    slit = (np.abs(local[:, 2] - middle) < SLIT) & (local[:, 1] < front + 14)
    slit &= (local[:, 0] > line[0, 0]) & (local[:, 0] < line[-1, 0])
    head = (head & ~slit).reshape(bone.shape)
    return np.where(bone, 900.0, np.where(head, 40.0, -1000.0)).astype(np.float32)


def _three(teeth) -> np.ndarray:
    """Last molar left and right and the incisors (3, 3) mm of an arch of teeth (t, 3), at its middle height."""
    level = np.median(teeth[:, 2])
    middle = (teeth[:, 0].min() + teeth[:, 0].max()) / 2
    places = []
    for side in (1, -1):
        half = teeth[side * (teeth[:, 0] - middle) > 0]
        places.append(half[half[:, 1] > half[:, 1].max() - 6].mean(axis=0))
    places.append(teeth[teeth[:, 1] < teeth[:, 1].min() + 5].mean(axis=0))
    return np.array([[x, y, level] for x, y, _ in places])


def _aligned(points, wanted) -> tuple[np.ndarray, np.ndarray]:
    """Rotation and shift of points (k, 3) onto others."""
    turn = Rotation.align_vectors(wanted - wanted.mean(axis=0), points - points.mean(axis=0))[0].as_matrix()
    return turn, wanted.mean(axis=0) - turn @ points.mean(axis=0)
