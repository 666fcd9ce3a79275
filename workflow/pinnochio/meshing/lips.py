"""Which nodes of a mesh are lips: those that face each other across the mouth slit."""

import numpy as np
from scipy import sparse
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from pinnochio.geometry.triangles import face_normals
from pinnochio.meshing.splitting import simplex_points
from pinnochio.model.patient import LOWER_LIP, NOT_LIP, UPPER_LIP

MOUTH = 22.0  # mm from the middle of the bite: reaches the front and the corners of the mouth, not the nostrils [I]
DEPTH = 15.0  # mm behind the front of the bite: beyond the corners of the mouth, not the cheeks beside the molars [I]
FACING = 0.3  # least cosine: of two lips towards each other, of a lip towards up or down [I]
PATCH = 0.25  # of the area of the largest; in coarse meshes a lip falls into halves [I]
BEHIND = 1.0  # mm by which lips may overlap where the mesh is coarse


def bite(bone, pairs, band_mm: float) -> np.ndarray:
    """Points (k, 3) mm half-way between the jaws that oppose each other, where they are nearer than `band_mm`.

    bone: points (b, 3) and segment (b,); pairs of segment indices.
    """
    middles = [np.zeros((0, 3))]
    for i, j in pairs:
        one, two = bone.points[bone.segment == i], bone.points[bone.segment == j]
        distance, nearest = cKDTree(two).query(one)
        middles.append((one + two[nearest])[distance < band_mm] / 2)
    return np.vstack(middles)


def near_mouth(points, mouth) -> np.ndarray:
    """Points (k,) bool of k x 3 in mm nearer than MOUTH to the middle of the bite, mouth (b, 3), and no further behind
    its front than DEPTH: both lips from the red to the vestibule. Nowhere without a bite."""
    if not len(mouth):
        return np.zeros(len(points), bool)
    return (cKDTree(mouth).query(points)[0] < MOUTH) & (points[:, 1] < mouth[:, 1].min() + DEPTH)


def lip_nodes(points, faces, airy, constrained, mouth, reach_mm: float = 5.0) -> np.ndarray:
    """Lip (n,) int8 of every node: NOT_LIP, UPPER_LIP or LOWER_LIP.

    points (n, 3) mm LPS; faces (f, 3) boundary triangles, outward; airy (f,) bool, air lies beyond; constrained (n,)
    bool, on bone or a cut; mouth (k, 3) mm, the middle of the bite.

    A face is lip if it is airy, not on bone, nearer than MOUTH to the middle of the bite, no further behind its front
    than DEPTH, looks down (upper lip) or up (lower lip), and most of the rays that leave it outward meet such a face of
    the other lip, which looks back, within `reach_mm`. Of the patches of a lip, connected by shared nodes, those
    smaller than PATCH of the largest are folds of skin or vestibule. Constrained nodes are no lips, nor are those of
    both or of a triangle with both: the corners of the mouth. No slit, no lips.
    """
    lip = np.full(len(points), NOT_LIP, np.int8)
    normals, _ = face_normals(points, faces)
    centre = points[faces].mean(axis=1)
    wanted = airy & ~constrained[faces].all(axis=1) & (np.abs(normals[:, 2]) > FACING)
    if not len(mouth) or not wanted.any():
        return lip
    wanted &= near_mouth(centre, mouth)
    near = np.flatnonzero(wanted)
    corners, ahead = points[faces[near]], normals[near]
    starts = np.einsum("kc,fcx->fkx", simplex_points(3, 2), corners)
    facing = (ahead[:, None, 2] * ahead[:, 2] < 0) & (ahead @ ahead.T < -FACING)
    met = np.array([_met(starts[i], ahead[i], corners[other], reach_mm) for i, other in enumerate(facing)], bool)
    lips = []
    for side in (-1, 1):
        lip_faces = faces[near[met & (side * ahead[:, 2] > 0)]]
        patch, size = _patches(points, lip_faces)
        on = np.zeros(len(points), bool)
        on[lip_faces[size[patch] > PATCH * size.max(initial=0)]] = True
        lips.append(on & ~constrained)
    lip[lips[0] & ~lips[1]], lip[lips[1] & ~lips[0]] = UPPER_LIP, LOWER_LIP
    mixed = (lip[faces] == UPPER_LIP).any(axis=1) & (lip[faces] == LOWER_LIP).any(axis=1)
    lip[faces[mixed]] = NOT_LIP
    return lip


def _patches(points, faces) -> tuple[np.ndarray, np.ndarray]:
    """Patch (f,) of every face, connected by shared nodes, and the area of each patch, mm2."""
    count = len(faces)
    row = np.repeat(np.arange(count), 3)
    touching = sparse.csr_array((np.ones(3 * count), (row, faces.ravel())), (count, len(points)))
    _, patch = connected_components(touching @ touching.T, directed=False)
    return patch, np.bincount(patch, face_normals(points, faces)[1])


def _met(starts, direction, corners, reach: float) -> bool:
    """Whether most rays from starts (k, 3) along a direction (3,) meet one of the triangles (g, 3, 3) in `reach`."""
    first, second = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    across = np.cross(direction, second)
    scale = np.einsum("gx,gx->g", first, across)  # not zero: the triangles face the ray
    offset = starts[:, None] - corners[:, 0]
    turned = np.cross(offset, first)
    u = np.einsum("kgx,gx->kg", offset, across) / scale
    v = turned @ direction / scale
    along = np.einsum("kgx,gx->kg", turned, second) / scale
    inside = (u >= -1e-9) & (v >= -1e-9) & (u + v <= 1 + 1e-9)
    return (inside & (along > -BEHIND) & (along < reach)).any(axis=1).mean() > 0.5
