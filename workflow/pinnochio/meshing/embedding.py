"""A fine surface carried by the coarser boundary of a mesh."""

import numpy as np
from scipy.sparse import coo_matrix, identity
from scipy.spatial import cKDTree

from pinnochio.geometry.triangles import closest_on_triangles, face_normals, vertex_normals

CANDIDATES = 24  # nearest triangles, by their centroids, among which the carrier is sought


def embed(points, faces, mesh_points, mesh_faces) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Triangle of the mesh boundary that carries each point of a surface.

    points (s, 3), faces (f, 3) outward: the fine surface; mesh_points (n, 3), mesh_faces (g, 3) outward: the boundary.
    Returns the carrier's nodes (s, 3), barycentric weights (s, 3) of its closest point, and the distance (s,) in mm,
    infinite where every candidate faces the other way (the other lip).
    """
    normals, own = face_normals(mesh_points, mesh_faces)[0], vertex_normals(points, faces)
    near = cKDTree(mesh_points[mesh_faces].mean(axis=1)).query(points, min(CANDIDATES, len(mesh_faces)))[1]
    corners = mesh_points[mesh_faces[near]]
    closest, weights = closest_on_triangles(points[:, None], corners)
    distance = np.linalg.norm(closest - points[:, None], axis=2)
    distance[np.einsum("skx,sx->sk", normals[near], own) < 0.2] = np.inf
    best = np.argmin(distance, axis=1)
    row = np.arange(len(points))
    return mesh_faces[near[row, best]], weights[row, best], distance[row, best]


def bridging(faces, nodes, mesh_faces) -> np.ndarray:
    """Faces (f,) bool of a fine surface that span a gap of the mesh, such as the slit between the lips.

    faces (f, 3) of the fine surface, nodes (s, 3) its carriers as :func:`embed` gives them, mesh_faces (g, 3). A face
    spans a gap if two of its corners hang on triangles that neither share a node nor have nodes joined by an edge.
    """
    count = mesh_faces.max() + 1
    pairs = mesh_faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    steps = coo_matrix((np.ones(len(pairs), np.float32), pairs.T), (count, count)).tocsr()
    near = steps + steps.T + identity(count, np.float32, format="csr")
    spans = np.zeros(len(faces), bool)
    for one, other in ((0, 1), (1, 2), (2, 0)):
        here = np.repeat(nodes[faces[:, one]], 3, axis=1).ravel()
        there = np.tile(nodes[faces[:, other]], 3).ravel()
        spans |= ~np.asarray(near[here, there]).reshape(-1, 9).any(axis=1)
    return spans
