"""The smallest patients: a block with every interface and node type, a slab over two bones, a head of skin alone."""

import numpy as np

from pinnochio.mechanics.problems import box
from pinnochio.model.labels import AIR, MUSCLE, SUPERFICIAL
from pinnochio.model.patient import (
    BONE_MUSCLE,
    BONE_SUPERFICIAL,
    FIXED,
    FREE,
    MOVING,
    MUSCLE_SUPERFICIAL,
    SLIDING,
    PatientModel,
)
from pinnochio.model.surfaces import bone_surface, skin_surface
from pinnochio.plans.plan import Plan, RigidMotion
from pinnochio.virtual.head import SEGMENTS


def squares(number: np.ndarray) -> np.ndarray:
    """Triangles (f, 3) int32 of a grid of node numbers, two to each square."""
    corners = np.stack([number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]], -1)
    return corners.reshape(-1, 4)[:, [[0, 1, 2], [0, 2, 3]]].reshape(-1, 3).astype(np.int32)


def tiny_patient(seed: int = 0, shape: tuple[int, int, int] = (7, 5, 4), edge: float = 5.0) -> PatientModel:
    """Block of shape nodes, `edge` mm apart and shaken by up to 0.5 mm; bone below, skin above, cut sides.

    Muscle is the lower layer where x is small. The bone's left half moves ("left"), its right end is cranium,
    the nodes between slide.
    """
    rng = np.random.default_rng(seed)
    nx, ny, nz = shape
    number = np.arange(nx * ny * nz).reshape(shape)
    index = np.stack(np.meshgrid(*map(np.arange, shape), indexing="ij"), -1).reshape(-1, 3)
    points = edge * index + rng.uniform(-0.5, 0.5, index.shape) + [10.0, -80.0, 40.0]
    low = number[:-1, :-1, :-1].ravel()
    step = np.array([ny * nz, nz, 1])
    cells = []
    for order in ((0, 1, 2), (1, 2, 0), (2, 0, 1), (0, 2, 1), (1, 0, 2), (2, 1, 0)):
        chain = np.concatenate([[0], np.cumsum(step[list(order)])])
        cells.append(low[:, None] + chain)
    cells = np.concatenate(cells)
    volume = np.linalg.det(points[cells[:, 1:]] - points[cells[:, :1]])
    cells[volume < 0] = cells[volume < 0][:, [0, 2, 1, 3]]
    middle = index[cells].mean(1)
    tissue = np.where((middle[:, 2] < 1) & (middle[:, 0] < nx // 2), MUSCLE, SUPERFICIAL).astype(np.int8)
    in_muscle, in_superficial = (np.isin(number.ravel(), cells[tissue == code]) for code in (MUSCLE, SUPERFICIAL))
    bone = index[:, 2] == 0
    cut = (index[:, 1] == 0) | (index[:, 1] == ny - 1)
    kind = np.zeros(len(points), np.int8)
    kind[in_muscle & in_superficial] = MUSCLE_SUPERFICIAL
    kind[bone & in_muscle] = BONE_MUSCLE
    kind[bone & ~in_muscle] = BONE_SUPERFICIAL
    kind[cut & ~bone] = 0
    node_type = np.zeros(len(points), np.int8)
    x = index[bone, 0]
    node_type[bone] = np.select([x < nx // 2, x < nx - 2], [MOVING, SLIDING], FIXED)
    node_type[cut] = FIXED
    node_segment = np.where(np.isin(node_type, (MOVING, SLIDING)), 0, -1).astype(np.int8)
    skin = squares(number[:, :, -1])
    plate = np.stack(np.meshgrid(np.arange(2 * nx - 1), np.arange(2 * ny - 1), indexing="ij"), -1)
    plate = plate.reshape(-1, 2)
    bone_points = np.column_stack([edge / 2 * plate, np.zeros(len(plate))]) + [10.0, -80.0, 39.0]
    bone_points += rng.uniform(-0.2, 0.2, bone_points.shape)
    segment = np.where(plate[:, 0] < 2 * (nx - 2), 0, -1).astype(np.int8)
    faces = squares(np.arange(len(plate)).reshape(2 * nx - 1, 2 * ny - 1))
    return PatientModel(
        points=points,
        cells=cells.astype(np.int32),
        tissue=tissue,
        node_type=node_type,
        node_segment=node_segment,
        node_beyond=np.where(bone, 11, -1).astype(np.int16),
        node_normal=np.where(bone[:, None], [0.0, 0.0, -1.0], 0.0),
        interface_kind=kind,
        skin_faces=skin,
        face_roi=np.ones(len(skin), bool),
        bone_points=bone_points,
        bone_normals=np.tile([0.0, 0.0, 1.0], (len(bone_points), 1)),
        bone_faces=faces[(segment[faces] == segment[faces[:, :1]]).all(1)],
        bone_segment=segment,
        segments=("left",),
    )


def tiny_plan(x: float = 1.0, y: float = -3.0, z: float = 1.5, pitch: float = 2.0) -> Plan:
    """A motion of the moving segment, mm and degrees."""
    return Plan("tiny", {"left": RigidMotion.from_degrees([pitch, 0, 0], [x, y, z], [15.0, -70.0, 39.0])})


def renumbered(model: PatientModel, order: np.ndarray) -> PatientModel:
    """The same patient with node `order[i]` as node i."""
    inverse = np.argsort(order).astype(np.int32)
    per_node = ("points", "node_type", "node_segment", "node_beyond", "node_normal", "interface_kind")
    values = {name: getattr(model, name)[order] for name in per_node}
    values |= {"cells": inverse[model.cells], "skin_faces": inverse[model.skin_faces]}
    return PatientModel(**(vars(model) | values))


def as_model(head) -> PatientModel:
    """A patient of bone and of skin as seen from the front, which is also the mesh; judged about where others are."""
    solid = np.maximum.accumulate(head.labels != AIR, axis=1)
    points, faces = skin_surface(np.where(solid, SUPERFICIAL, AIR), head.spacing, head.origin)
    bone = bone_surface(head.labels, head.spacing, head.origin, SEGMENTS, 5)
    count = len(points)
    centre = points[faces].mean(axis=1)
    top = bone.points[bone.segment == SEGMENTS.index("lefort1"), 2].max() + 20
    return PatientModel(
        points=points,
        cells=np.zeros((0, 4), np.int32),
        tissue=np.zeros(0, np.int8),
        node_type=np.zeros(count, np.int8),
        node_segment=np.full(count, -1, np.int8),
        node_beyond=np.zeros(count, np.int16),
        node_normal=np.zeros((count, 3)),
        interface_kind=np.zeros(count, np.int8),
        skin_faces=faces,
        face_roi=(centre[:, 2] < top) & (centre[:, 1] < -15),
        bone_points=bone.points,
        bone_normals=bone.normals,
        bone_faces=bone.faces,
        bone_segment=bone.segment,
        segments=SEGMENTS,
    )


def slab_patient():
    """A slab over a flat bone at z = 0 whose left half belongs to another segment; its back plate faces away."""
    points, cells = box((24, 12, 9), (8, 4, 3), jitter=0.1)
    on_bone = points[:, 2] == 0
    node_type = np.where(on_bone, np.where(points[:, 1] < 4, SLIDING, MOVING), FREE).astype(np.int8)
    node_type[(points[:, 0] == 0)] = FIXED
    segment = np.where(points[:, 0] < 12, 0, 1)
    grid = np.stack(np.meshgrid(np.arange(-20, 46, 2.0), np.arange(-20, 34, 2.0)), axis=-1).reshape(-1, 2)
    front = np.column_stack([grid, np.zeros(len(grid))])
    bone, count = np.vstack([front, front - [0, 0, 0.4]]), len(front)
    normal = np.repeat([[0, 0, 1.0], [0, 0, -1.0]], count, axis=0)
    return PatientModel(
        points=points,
        cells=cells,
        tissue=np.ones(len(cells), np.int8),
        node_type=node_type,
        node_segment=np.where(np.isin(node_type, (MOVING, SLIDING)), segment, -1).astype(np.int8),
        node_beyond=np.where(on_bone, 11 + segment, -1).astype(np.int16),
        node_normal=np.where(on_bone[:, None], [0, 0, -1.0], 0.0),
        interface_kind=np.zeros(len(points), np.int8),
        skin_faces=np.zeros((0, 3), np.int32),
        face_roi=np.zeros(0, bool),
        bone_points=bone,
        bone_normals=normal,
        bone_faces=np.zeros((0, 3), np.int32),
        bone_segment=np.where(bone[:, 0] < 12, 0, 1).astype(np.int8),
        segments=("lefort1", "mandible_distal"),
    )


def bony_patient(segments: tuple[str, ...]) -> PatientModel:
    """The block of :func:`tiny_patient` with a box of bone for each segment, where a head has it; nothing moves it."""
    places = {"lefort1": (0, -70, 10), "mandible_distal": (0, -65, -25), "proximal_left": (45, -20, 0),
              "proximal_right": (-45, -20, 0), "chin": (0, -75, -40), "mandible": (0, -40, -20),
              "lefort1_left": (15, -60, 10), "lefort1_right": (-15, -60, 10),
              "lefort1_front": (0, -80, 10)}  # fmt: skip
    grid = np.stack(np.meshgrid(*[np.linspace(-1, 1, 5)] * 3, indexing="ij"), -1).reshape(-1, 3)
    size = {"mandible": (50, 40, 20)}
    parts = [grid * size.get(name, (12, 14, 10)) + places[name] for name in segments]
    bone = np.vstack(parts)
    changes = {
        "bone_points": bone,
        "bone_normals": np.tile([0.0, 0, 1], (len(bone), 1)),
        "bone_faces": np.zeros((0, 3), np.int32),
        "bone_segment": np.repeat(np.arange(len(segments)), len(grid)).astype(np.int8),
        "segments": segments,
    }
    return PatientModel(**(vars(tiny_patient()) | changes))
