"""Structure of a field on a face: its bands, how far it is correlated, its slope, what sides and patients share.

A field is a number (n,) at points (n, 3) mm of a surface, with areas (n,) mm2 as weights. Definitions as the three
operated patients were measured that the virtual cohort is held against [X].
"""

from collections.abc import Sequence
from itertools import combinations

import numpy as np
from scipy import sparse
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from pinnochio.geometry.triangles import face_normals

WIDTHS = (2.5, 6.0, 12.0, 24.0)  # mm, SD of the Gaussians; a band lies between one and the next
CUT = 3.0  # of a Gaussian's SD, beyond which it counts nothing
SAMPLES, LAG = 2500, 2.0  # points of the semivariogram, mm of its classes
FITS = 30  # steps of the rigid fit of a mirrored face
FLAT = 1e-6  # mm2, of a triangle between points of both lips that lie at one place


def mean_square(values, areas) -> float:
    """Mean square of a field, by area."""
    return float(np.average(np.square(values), weights=areas))


def smoothed(points, areas, fields, width: float) -> np.ndarray:
    """Fields (..., n) averaged by area under a Gaussian of SD `width` mm, distances in space."""
    points = np.asarray(points)
    pairs = cKDTree(points).sparse_distance_matrix(cKDTree(points), CUT * width, output_type="coo_matrix")
    weight = np.exp(-0.5 * (pairs.data / width) ** 2) * np.asarray(areas)[pairs.col]
    kernel = sparse.csr_array((weight, (pairs.row, pairs.col)), shape=(len(points),) * 2)
    return (kernel @ np.asarray(fields).T / np.asarray(kernel.sum(axis=1)).reshape(-1, *[1] * (np.ndim(fields) - 1))).T


def without_rigid_part(points, normals, areas, values) -> np.ndarray:
    """A field (n,) along normals (n, 3) less what a small rigid motion explains of it, by least squares."""
    points = np.asarray(points) - np.average(points, axis=0, weights=areas)
    motions = np.hstack([normals, np.cross(points, normals)])
    root = np.sqrt(areas)
    amounts = np.linalg.lstsq(motions * root[:, None], values * root, rcond=None)[0]
    return values - motions @ amounts


def bands(points, areas, values) -> list[float]:
    """SD of a field (n,) between each of :data:`WIDTHS` and the next."""
    levels = [smoothed(points, areas, values, width) for width in WIDTHS]
    return [
        float(np.sqrt(mean_square(fine - broad - np.average(fine - broad, weights=areas), areas)))
        for fine, broad in zip(levels, levels[1:], strict=False)
    ]


def correlation_lengths(points, areas, values, levels=(0.5, 0.1), seed: int = 0) -> list[float]:
    """Distances (mm) at which the correlation of a field first falls to these levels: one less the semivariogram over
    the variance, of points drawn by area; NaN where it never does."""
    areas = np.asarray(areas, float)
    chosen = np.random.default_rng(seed).choice(len(areas), SAMPLES, p=areas / areas.sum())
    points, values = np.asarray(points)[chosen], np.asarray(values)[chosen]
    one, other = np.triu_indices(SAMPLES, 1)
    distance = np.linalg.norm(points[one] - points[other], axis=1)
    group = (distance / LAG).astype(int)
    count = np.bincount(group)
    gamma = 0.5 * np.bincount(group, (values[one] - values[other]) ** 2) / np.maximum(count, 1)
    at = np.bincount(group, distance) / np.maximum(count, 1)
    at, correlation = np.append(0, at[count > 0]), np.append(1, 1 - gamma[count > 0] / values.var())
    return [_first_crossing(at, correlation, level) for level in levels]


def _first_crossing(at, values, level: float) -> float:
    below = np.flatnonzero(values <= level)
    if not len(below) or below[0] == 0:
        return float("nan")
    after = below[0]
    return float(np.interp(-level, -values[[after - 1, after]], at[[after - 1, after]]))


def slope(points, faces, areas, values) -> float:
    """Root mean square gradient, in degrees, of a field (n,) mm smoothed by the least of :data:`WIDTHS`; faces (f, 3)
    index the points; triangles without area count nothing."""
    points = np.asarray(points)
    fine = smoothed(points, areas, values, WIDTHS[0])
    normal, area = face_normals(points, faces)
    faces, normal, area = (of[area > FLAT] for of in (np.asarray(faces), normal, area))
    corners = points[faces]
    against = np.roll(corners, -2, axis=1) - np.roll(corners, -1, axis=1)  # the edge against each corner
    gradient = np.einsum("fc,fcx->fx", fine[faces], np.cross(normal[:, None], against)) / (2 * area[:, None])
    return float(np.degrees(np.arctan(np.sqrt(np.average((gradient**2).sum(axis=1), weights=area)))))


def mirror_images(points) -> np.ndarray:
    """For each point of a face (n, 3) the point (n,) that lies nearest to its mirror image, x to -x, once the image is
    fitted rigidly to the face."""
    points = np.asarray(points, float)
    tree, image = cKDTree(points), points * [-1, 1, 1]
    image += points.mean(axis=0) - image.mean(axis=0)
    for _ in range(FITS):
        near = points[tree.query(image)[1]]
        middle, aim = image.mean(axis=0), near.mean(axis=0)
        turn = Rotation.align_vectors(near - aim, image - middle)[0]
        image = turn.apply(image - middle) + aim
    return tree.query(image)[1]


def symmetric_share(areas, values, mirror) -> float:
    """Share of the mean square of a field (n,) that is the same on both sides; mirror (n,) as of
    :func:`mirror_images`."""
    other = np.asarray(values)[mirror]
    both = (mean_square(values, areas) + mean_square(other, areas)) / 2
    return mean_square((values + other) / 2, areas) / both


def common_share(areas, fields: Sequence[np.ndarray]) -> float:
    """Share of the mean square that patients have in common: of fields (n,) at corresponding points, the mean product
    of two patients over the mean square."""
    products = [np.average(one * other, weights=areas) for one, other in combinations(fields, 2)]
    return float(np.mean(products) / np.mean([mean_square(field, areas) for field in fields]))
