"""The cuts of an operation: which voxels of a virtual skull belong to which bone segment."""

import numpy as np

from pinnochio.model.labels import CRANIUM, segment_code
from pinnochio.virtual.procedures import Procedure
from pinnochio.virtual.skeleton import SIDES, Skeleton

PREMAXILLA = 15.0  # mm behind the upper incisors' edge: between canine and premolar, where the front piece ends [I]
CHIN_HEIGHT, CHIN_WIDTH = 13.0, 20.0  # mm above menton and either side of it [I]


def cut(s: Skeleton, skull: np.ndarray, jaw: np.ndarray, grid_xyz, procedure: Procedure) -> np.ndarray:
    """Codes (nx, ny, nz) uint8 of the bones after the cuts of a procedure, 0 elsewhere.

    skull, jaw: bool volumes; grid_xyz: coordinates (mm) that broadcast to them. The codes are those of the procedure's
    segments, in their order; bone that no cut frees is cranium.
    """
    x, y, z = grid_xyz
    code = {name: segment_code(index) for index, name in enumerate(procedure.segments)}
    bone = np.where(skull | jaw, CRANIUM, 0).astype(np.uint8)
    upper = skull & (z < s.cut_height(y)) & (np.abs(x) < 38 * s.wide) & (y < s.molar_y + 7)
    halves = {"lefort1": True, "lefort1_left": x > 0, "lefort1_right": x <= 0,
              "lefort1_front": y < s.upper_incisor[1] + PREMAXILLA * s.deep}  # fmt: skip
    for name, part in halves.items():
        if name in code:
            bone[upper & part] = code[name]
    body = code.get("mandible_distal", code.get("mandible"))
    bone[jaw] = body
    if "mandible_distal" in code:
        for side, name in zip(SIDES, ("proximal_left", "proximal_right"), strict=True):
            bone[jaw & split_sides(s, x, y, z, side)] = code[name]
    if "chin" in code:
        near = (z < s.menton[2] + CHIN_HEIGHT) & (np.abs(x - s.menton[0]) < CHIN_WIDTH * s.wide)
        bone[near & (bone == body)] = code["chin"]
    return bone


def split_sides(s: Skeleton, x: np.ndarray, y: np.ndarray, z: np.ndarray, side: float) -> np.ndarray:
    """Where the sagittal split leaves mandible with the ramus of one side (proximal segment).

    Lateral plate from the second molar back, whole thickness behind the lingula and above it.
    """
    border = s.border()
    half = border[border[:, 0] * side > abs(s.menton[0])]
    half = half[np.argsort(half[:, 1])]
    middle = np.interp(y, half[:, 1], half[:, 0] * side).astype(np.float32)
    lateral = (x * side > middle) & (y > s.lower_incisor[1] + 37 * s.deep)
    lateral &= np.abs(x) > 28 * s.wide
    return (x * side > 0) & (
        lateral
        | (y > s.gonion[1] - 18) & (y > s.molar_y + 12)
        | (z > s.upper_edge(s.molar_y) + 14)
        | (z > s.lower_edge(s.molar_y) - 4) & (y > s.molar_y + 3)
    )
