"""Lips that bear on each other: which nodes and triangles of the mesh meet."""

import numpy as np
from scipy.spatial import cKDTree

from pinnochio.geometry.triangles import face_normals, vertex_areas
from pinnochio.mechanics.boundary.contact import ContactSet

MARGIN = 6.0  # mm around a lip that still belongs to its surface: where the other lip slides to [I]
ACROSS = 0.5  # least cosine between a triangle's normal and the direction from its lip to the other


def facing_sets(points, faces, one, two, constrained=None) -> list[ContactSet]:
    """Contact of the nodes `one` (s,) with the nodes `two` (t,), each against the other's surface.

    points (n, 3) mm; faces (f, 3): boundary triangles; constrained (n,) bool. A surface is every face that looks
    across to the other nodes, has one of its own nodes or lies around them, nearer than MARGIN to one and further from
    the other's, holds no node of the other and is not constrained at all three corners. A node has the area of the
    faces around it that look across; without one it is left out. Empty if there is no surface.
    """
    if not len(one) or not len(two):
        return []
    middle, (normals, areas) = points[faces].mean(axis=1), face_normals(points, faces)
    mine, others = (np.isin(faces, nodes).all(axis=1) for nodes in (one, two))
    across = areas[mine] @ normals[mine] - areas[others] @ normals[others]
    across /= max(np.linalg.norm(across), 1e-12)
    loose = np.ones(len(faces), bool) if constrained is None else ~constrained[faces].all(axis=1)
    looking = np.abs(normals @ across) > ACROSS
    away = [cKDTree(points[nodes]).query(middle)[0] for nodes in (one, two)]
    sets = []
    for side, other, there, here, ahead in ((one, two, *away, -across), (two, one, *away[::-1], across)):
        surface = np.isin(faces, other).any(axis=1) | ((here < MARGIN) & (here < there))
        surface &= loose & (normals @ ahead > ACROSS) & ~np.isin(faces, side).any(axis=1)
        part = vertex_areas(points, faces[looking])[side]
        if surface.any() and part.any():
            sets.append(ContactSet(side[part > 0], part[part > 0], faces[surface]))
    return sets
