"""One surface carried smoothly onto another one that shows the same thing after it has changed."""

import numpy as np

from pinnochio.geometry.closest_points import closest_points
from pinnochio.geometry.triangles import sample_surface, vertex_normals

# Standard deviation (mm) and length (mm) of the Gaussian fields that the way is a sum of: jaws, then lips and nose [I].
FIELDS = ((10.0, 40.0), (4.0, 15.0))
SPACING = 0.75  # of the length: distance between the points that carry a field
NOISE = 1.0  # mm that a sample may keep off the target
SAMPLES, STEPS = 2500, 8
FACING = 0.5  # cosine of the normals of two points that can be the same one


def carried(points, faces, target_points, target_faces, part, start, seed: int) -> np.ndarray:
    """Points (p, 3) mm of a surface where they are on the target, as a smooth motion brings them there.

    faces (f, 3); part (f,) bool: the faces that are to fit, all points follow them; start (p, 3) mm: about where the
    points are, from which the first pairs are found and nothing else. The motion is the most likely one
    of a Gaussian field (FIELDS) of which each sample of `part` says how far the target is along its normal: that
    leaves the surface free along itself where nothing holds it. Samples are paired with closest points, coarse fields
    first, anew in every step; without a partner are those at an open border of the target or before a surface that
    faces elsewhere. Where none has a partner the points stay where they are.
    """
    points, faces = np.asarray(points, float), np.asarray(faces)
    normals = vertex_normals(target_points, target_faces)
    samples = sample_surface(points, faces[part], SAMPLES, seed)
    here = closest_points(samples, points, faces)
    corners, weights = faces[here.face], here.weights
    moved = np.asarray(start, float)
    for count in range(1, len(FIELDS) + 1):
        basis, prior = _fields(samples, points, FIELDS[:count])
        everywhere = basis(points)
        for _ in range(STEPS):
            placed = np.einsum("sc,scx->sx", weights, moved[corners])
            near = closest_points(placed, target_points, target_faces)
            corner_normals = vertex_normals(moved, faces)[corners]
            facing = np.einsum("sc,scx->sx", near.weights, normals[target_faces[near.face]])
            facing /= np.maximum(np.linalg.norm(facing, axis=1, keepdims=True), 1e-9)
            paired = ~near.border & (np.einsum("sx,scx,sc->s", facing, corner_normals, weights) > FACING)
            if not paired.any():
                return moved
            wanted = np.einsum("sx,sx->s", facing, near.points - samples)[paired]
            system = np.einsum("sx,sk->skx", facing[paired], basis(samples[paired])).reshape(len(wanted), -1)
            normal_matrix = system.T @ system / NOISE**2 + np.kron(prior, np.eye(3))
            field = np.linalg.solve(normal_matrix, system.T @ wanted / NOISE**2).reshape(-1, 3)
            moved = points + everywhere @ field
    return moved


def _fields(samples, points, fields):
    """Function of places (k, 3) that gives the values (k, c) of all carriers there, and the prior (c, c) of these."""
    carriers = [_spread(samples, SPACING * length) for _, length in fields]

    def kernel(one, two, deviation, length):
        square = ((one**2).sum(axis=1)[:, None] + (two**2).sum(axis=1) - 2 * one @ two.T).clip(0)
        return deviation**2 * np.exp(-square / (2 * length**2))

    def basis(places) -> np.ndarray:
        return np.hstack([kernel(places, centres, *field) for centres, field in zip(carriers, fields, strict=True)])

    ends = np.cumsum([0, *map(len, carriers)])
    prior = 1e-6 * np.eye(ends[-1])
    for start, centres, field in zip(ends, carriers, fields, strict=False):
        block = slice(start, start + len(centres))
        prior[block, block] += kernel(centres, centres, *field)
    return basis, prior


def _spread(points, apart: float) -> np.ndarray:
    """Of the points (k, 3) one in every cube of this edge (mm)."""
    _, first = np.unique(np.floor(points / apart).astype(int), axis=0, return_index=True)
    return points[np.sort(first)]
