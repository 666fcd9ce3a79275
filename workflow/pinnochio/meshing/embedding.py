"""A fine surface carried by the coarser boundary of a mesh."""

import numpy as np
from scipy.sparse import coo_matrix, identity
from scipy.spatial import cKDTree

from pinnochio.geometry.triangles import closest_on_triangles, face_normals, vertex_normals

CANDIDATES = 24  # nearest triangles, by their centroids, among which the carrier is sought


def embed(
    points, faces, mesh_points, mesh_faces, sides=None, reach=np.inf
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Triangle of the mesh boundary that carries each point of a surface.

    points (s, 3), faces (f, 3) outward: the fine surface; mesh_points (n, 3), mesh_faces (g, 3) outward: the boundary.
    sides: lip (s,) of each point and (n,) of each node, 0 where unknown. Where a gap parts the nearest triangle, of the
    other lip, from the nearest one of its own within `reach` mm, the latter carries: a coarse mesh opens the slit
    elsewhere.
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
        # Of its own lip any triangle will do: at the slit skin and mesh face each their own way.
        same = np.argmin(np.where(same_lip, away, np.inf), axis=1)
        moved = other[row, best] & same_lip[row, same] & (away[row, same] < reach)
        if moved.any():
            one, another = (mesh_faces[near[row, choice]][moved] for choice in (best, same))
            moved[moved] = _parted(one, another, _joined(mesh_faces))
        best = np.where(moved, same, best)
        distance[moved] = away[moved]
    return mesh_faces[near[row, best]], weights[row, best], distance[row, best]


def bridging(faces, nodes, mesh_faces) -> np.ndarray:
    """Faces (f,) bool of a fine surface that span a gap of the mesh, such as the slit between the lips.

    faces (f, 3) of the fine surface, nodes (s, 3) its carriers as :func:`embed` gives them, mesh_faces (g, 3). A face
    spans a gap if two of its corners hang on triangles that neither share a node nor have nodes joined by an edge.
    """
    joined, spans = _joined(mesh_faces), np.zeros(len(faces), bool)
    for one, other in ((0, 1), (1, 2), (2, 0)):
        spans |= _parted(nodes[faces[:, one]], nodes[faces[:, other]], joined)
    return spans


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
