"""Which lip skin and mesh belong to: the one that is nearer through the tissue. Every mesh of a patient parts the lips
alike, wherever its own slit lies."""

from collections.abc import Callable

import numpy as np
from scipy import ndimage
from scipy.sparse.csgraph import dijkstra
from scipy.spatial import cKDTree

from pinnochio.geometry.mesh_topology import edge_graph, edges_of
from pinnochio.meshing.fields import grown, is_tissue
from pinnochio.meshing.lips import near_mouth
from pinnochio.model.labels import AIR
from pinnochio.model.patient import LOWER_LIP, NOT_LIP, UPPER_LIP

SIDES = UPPER_LIP, LOWER_LIP
AROUND = 25.0  # mm about the bite in which the lips are sought
REACH = 15.0  # mm through the tissue from the slit: farther from it nothing is told apart
THICK = 5.0  # mm: the widest slit between lips


def sides_of_points(labels, spacing, origin, mouth) -> Callable[[np.ndarray], np.ndarray]:
    """Lip (k,) int8 of the tissue nearest to points (k, 3) mm: UPPER_LIP, LOWER_LIP, or NOT_LIP where there is none.

    labels (nx, ny, nz) at spacing, origin (3,) mm; mouth (b, 3) mm, the middle of the bite.
    """
    if not len(mouth):
        return lambda points: np.full(len(points), NOT_LIP, np.int8)
    low, high = ((end - origin) / spacing for end in (mouth.min(axis=0) - AROUND, mouth.max(axis=0) + AROUND))
    low = np.clip(np.floor(low).astype(int), 0, labels.shape)
    high = np.clip(np.ceil(high).astype(int) + 1, 0, labels.shape)
    part = labels[tuple(slice(*ends) for ends in zip(low, high, strict=True))]
    tissue, side = is_tissue(part), np.zeros(part.shape, np.int8)
    for code, front in zip(SIDES, _beside_slit(part, tissue, spacing, origin + low * spacing, mouth), strict=True):
        side[front] = code
    for _ in range(int(REACH / spacing.max())):
        for code, reached in [(code, grown(side == code)) for code in SIDES]:
            side[reached & tissue & (side == 0)] = code
    tree, sides = cKDTree(origin + (low + np.argwhere(tissue)) * spacing), side[tissue]

    def lips(points: np.ndarray) -> np.ndarray:
        lip = np.full(len(points), NOT_LIP, np.int8)
        inside = ((points > origin + low * spacing) & (points < origin + high * spacing)).all(axis=1)
        if tree.n and inside.any():
            lip[inside] = sides[tree.query(points[inside])[1]]
        return lip

    return lips


def _beside_slit(labels, tissue, spacing, origin, mouth) -> tuple[np.ndarray, np.ndarray]:
    """Tissue (nx, ny, nz) bool right above and right below the slit: the largest void, of all that are THICK high at
    most and near the mouth; smaller ones are folds of skin."""
    slit = ndimage.binary_closing(tissue, np.ones((1, 1, int(THICK / spacing[2]) + 1))) & (labels == AIR)
    voxels = np.argwhere(slit)
    slit[tuple(voxels[~near_mouth(origin + spacing * voxels, mouth)].T)] = False
    piece, count = ndimage.label(slit, np.ones((3, 3, 3)))
    slit = piece == (np.bincount(piece.ravel())[1:].argmax() + 1 if count else -1)
    above, below = np.zeros_like(slit), np.zeros_like(slit)
    above[:, :, 1:], below[:, :, :-1] = slit[:, :, :-1], slit[:, :, 1:]
    return above & tissue, below & tissue


def sides_of_nodes(points, cells, lip) -> np.ndarray:
    """Lip (n,) int8 of each node of a mesh, points (n, 3) mm and cells (m, 4): of the nearest one of lip (n,) along its
    edges; NOT_LIP beyond REACH of either."""
    graph = edge_graph(points, edges_of(cells)[0])
    ways = np.full((len(SIDES), len(points)), np.inf)
    for way, code in zip(ways, SIDES, strict=True):
        sources = np.flatnonzero(lip == code)
        if len(sources):
            way[:] = dijkstra(graph, directed=False, indices=sources, min_only=True, limit=REACH)
    upper, lower = ways
    return np.where(upper < lower, UPPER_LIP, np.where(lower < upper, LOWER_LIP, NOT_LIP)).astype(np.int8)
