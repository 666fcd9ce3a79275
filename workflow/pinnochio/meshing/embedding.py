"""A fine surface carried by the coarser boundary of a mesh."""

import numpy as np
from scipy.sparse import coo_matrix, identity
from scipy.spatial import cKDTree

from pinnochio.geometry.triangles import closest_on_triangles, face_normals, vertex_normals

STEPS = 10  # of an edge, at which it is looked for where one lip ends and the other begins
CANDIDATES = 24  # nearest triangles, by their centroids, among which the carrier is sought


def embed(
    points, faces, mesh_points, mesh_faces, sides=None, reach=np.inf
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Triangle of the mesh boundary that carries each point of a surface.

    points (s, 3), faces (f, 3) outward: the fine surface; mesh_points (n, 3), mesh_faces (g, 3) outward: the boundary.
    sides: lip (s,) of each point and (n,) of each node, 0 where unknown. Where no candidate faces a point, or a gap
    parts the nearest triangle, of the other lip, from the nearest one of its own within `reach` mm, the latter carries:
    a coarse mesh opens the slit elsewhere, and there either may face its own way.
    Returns the carrier's nodes (s, 3), barycentric weights (s, 3) of its closest point, and the distance (s,) in mm,
    infinite where every candidate faces the other way (the other lip).
    """
    normals, point_normals = face_normals(mesh_points, mesh_faces)[0], vertex_normals(points, faces)
    near = cKDTree(mesh_points[mesh_faces].mean(axis=1)).query(points, min(CANDIDATES, len(mesh_faces)))[1]
    corners = mesh_points[mesh_faces[near]]
    closest, weights = closest_on_triangles(points[:, None], corners)
    away = np.linalg.norm(closest - points[:, None], axis=2)
    distance = np.where(np.einsum("skx,sx->sk", normals[near], point_normals) < 0.2, np.inf, away)
    best, row = np.argmin(distance, axis=1), np.arange(len(points))
    if sides is not None:
        lip, wanted = sides[1][mesh_faces], sides[0][:, None]
        lip = np.where((lip == lip[:, :1]).all(axis=1), lip[:, 0], 0)[near]
        same_lip, other = (lip > 0) & (lip == wanted), (lip > 0) & (wanted > 0) & (lip != wanted)
        same = np.argmin(np.where(same_lip, away, np.inf), axis=1)
        moved = same_lip[row, same] & (away[row, same] < reach)
        parted = moved & other[row, best]
        moved &= np.isinf(distance[row, best])
        if parted.any():
            one, another = (mesh_faces[near[row, choice]][parted] for choice in (best, same))
            moved[parted] |= _parted(one, another, _joined(mesh_faces))
        best = np.where(moved, same, best)
        distance[moved] = away[moved]
    return mesh_faces[near[row, best]], weights[row, best], distance[row, best]


def bridging(faces, nodes, mesh_faces) -> np.ndarray:
    """Edges (f, 3) bool of a fine surface, from each corner of a face to the next, that span a gap of the mesh, such as
    the slit between the lips.

    faces (f, 3) of the fine surface, nodes (s, 3) its carriers as :func:`embed` gives them, mesh_faces (g, 3). An edge
    spans a gap if its ends hang on triangles that neither share a node nor have nodes joined by an edge.
    """
    joined = _joined(mesh_faces)
    return np.stack([_parted(nodes[faces[:, k]], nodes[faces[:, k - 2]], joined) for k in range(3)], axis=1)


def cut_between_lips(points, faces, lip, spans, side) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A surface (points (s, 3) mm, faces (f, 3), lip (s,) of each point) cut along the line between the lips.

    spans (f, 3): edges as of :func:`bridging`; those that join the lips are cut where `side`, the lip of points (k, 3),
    changes. Returns the three with two more points at each cut, one of either lip.
    """
    following = np.roll(faces, -1, axis=1)
    cut = spans & (np.minimum(lip[faces], lip[following]) > 0) & (lip[faces] != lip[following])
    pairs, numbers = np.unique(np.sort(np.stack([faces[cut], following[cut]], 1), axis=1), axis=0, return_inverse=True)
    if not len(pairs):
        return points, faces, lip
    start, way = points[pairs[:, 0]], points[pairs[:, 1]] - points[pairs[:, 0]]
    along = (np.arange(STEPS) + 0.5)[:, None, None] / STEPS
    sides = side((start + along * way).reshape(-1, 3)).reshape(STEPS, -1)
    places = start + (sides == lip[pairs[:, 0]]).mean(axis=0)[:, None] * way
    number = np.zeros(faces.shape, int)
    number[cut] = numbers.ravel()
    # Turned so that the edge after the first corner is cut, and of two that are, also the one before it.
    count = cut.sum(axis=1)
    first = np.argmax(cut & ((count < 2)[:, None] | np.roll(cut, 1, axis=1)), axis=1)
    order = (first[:, None] + np.arange(3)) % 3
    (a, b, c), (p, _, q) = (np.take_along_axis(each, order, 1)[count > 0].T for each in (faces, number))

    def beside(cuts, corner):
        return len(points) + 2 * cuts + (lip[corner] == lip[pairs[cuts, 1]])

    twice = count[count > 0] > 1
    parts = [
        np.stack([a, beside(p, a), np.where(twice, beside(q, a), c)], 1),
        np.stack([beside(p, b), b, c], 1),
        np.stack([beside(p, b), c, beside(q, c)], 1)[twice],
    ]
    faces = np.vstack([faces[count == 0], *parts])
    return np.vstack([points, places.repeat(2, axis=0)]), faces, np.concatenate([lip, lip[pairs].ravel()])


def _joined(faces):
    """Nodes (n, n) that an edge of faces (g, 3) joins, each with itself too; sparse."""
    count = faces.max() + 1
    pairs = faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    steps = coo_matrix((np.ones(len(pairs), np.float32), pairs.T), (count, count)).tocsr()
    return steps + steps.T + identity(count, np.float32, format="csr")


def _parted(one, other, joined) -> np.ndarray:
    """Whether triangles (k, 3) and (k, 3) share no node and have none joined by an edge."""
    near = joined[np.repeat(one, 3, axis=1).ravel(), np.tile(other, 3).ravel()]
    return ~np.asarray(near).reshape(-1, 9).any(axis=1)
