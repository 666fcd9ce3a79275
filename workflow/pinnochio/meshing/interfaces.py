"""What each node of the mesh touches, and so which boundary condition and which interface it belongs to."""

import logging
from itertools import combinations
from typing import NamedTuple

import numpy as np
from scipy import ndimage, sparse
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from pinnochio.errors import InputError
from pinnochio.geometry.triangles import corner_sums, face_normals
from pinnochio.meshing.embedding import bridging, cut_between_lips, embed
from pinnochio.meshing.fields import is_tissue, nearest_voxels, signed_distance
from pinnochio.meshing.lip_sides import sides_of_nodes, sides_of_points
from pinnochio.meshing.lips import bite, lip_nodes
from pinnochio.meshing.mesh import TetMesh
from pinnochio.meshing.splitting import simplex_points
from pinnochio.model import patient as m
from pinnochio.model.bones import nasion_height, of_segments
from pinnochio.model.labels import AIR, CRANIUM, FIRST_SEGMENT, MUSCLE, SUPERFICIAL, segment_code, segment_name
from pinnochio.model.surfaces import BoneSurface
from pinnochio.plans.roles import UNCUT, of_role

LOG = logging.getLogger(__name__)
NO_BODY = -9
CUT_REACH = 15.0  # mm: a moving bone so near a cut below it moves the tissue there [I]
ON_BORDER = 1e-3  # mm


class LabelMap(NamedTuple):
    """labels (nx, ny, nz) internal codes [ix, iy, iz]; spacing and origin (3,) mm."""

    labels: np.ndarray
    spacing: np.ndarray
    origin: np.ndarray


class MeshBoundary(NamedTuple):
    """Outward triangles (f, 3) of a mesh; tissue (f,) of their cells; normals (f, 3); areas (f,) mm2;
    code beyond (f, k) some points of each."""

    faces: np.ndarray
    tissue: np.ndarray
    normals: np.ndarray
    areas: np.ndarray
    beyond: np.ndarray


def label_interfaces(
    mesh: TetMesh,
    labels,
    spacing,
    origin,
    segments: tuple[str, ...],
    bone: BoneSurface,
    skin: tuple[np.ndarray, np.ndarray] | None = None,
    *,
    sliding_band: float = 18.0,
    release: float = 5.0,
    reach: float = 5.0,
    contact_gap: float = 1.0,
    contact_share: float = 1 / 3,
    opening: float = 5.0,
    nasion_above_maxilla: float = 20.0,
    tragus_before_mandible: float = 10.0,
    cut_margin: float = 8.0,
) -> m.PatientModel:
    """The patient model of a mesh: node types, interface kinds, normals, skin and judged face.

    labels (nx, ny, nz) internal codes [ix, iy, iz], spacing and origin (3,) mm: the map that was meshed. skin: points
    (s, 3) and faces (f, 3) of a finer outer skin for the mesh to carry; without it the skin is the mesh's own. Each of
    its points hangs on its own lip (:mod:`pinnochio.meshing.lip_sides`), wherever the mesh opens the slit.

    What lies beyond a node: :func:`_nodes_beyond`, by rays of up to `reach` that take air up to `contact_gap` thick in
    front of bone for bone. Its type: :func:`_node_types`, with :func:`opposing_pairs`. Its interface: :func:`_kinds`.
    Outer skin: :func:`_skin`, with a ball of diameter `opening`. The part of it that is judged: :func:`_judged`.
    """
    label_map = LabelMap(np.asarray(labels), np.asarray(spacing, float), np.asarray(origin, float))
    segments = tuple(segments)
    unknown = set(np.unique(bone.segment)) - set(range(-1, len(segments)))
    if unknown:
        raise InputError("-", "bone surface", f"has segments {sorted(unknown)}", "make it with the same segments")

    points = mesh.points
    faces, owner = mesh.boundary_faces()
    normals, areas = face_normals(points, faces)
    beyond, ends = _beyond(points, faces, normals, *label_map, reach, contact_gap)
    boundary = MeshBoundary(faces, mesh.tissue[owner], normals, areas, beyond)
    node_beyond, contact = _nodes_beyond(boundary, len(points), len(segments), contact_share)
    pairs = opposing_pairs(bone, *label_map, segments, sliding_band)
    LOG.info("opposing bones: %s", [tuple(segment_name(i, segments) for i in pair) for pair in pairs])
    node_type, node_segment = _node_types(mesh, node_beyond, contact, bone, pairs, label_map, sliding_band, release)

    outer = faces[_skin(faces, beyond, ends, areas, *label_map, opening)]
    airy, mouth = (beyond == AIR).mean(axis=1) > 0.5, bite(bone, pairs, sliding_band)
    lip = lip_nodes(points, faces, airy, node_type != m.FREE, mouth)
    carried = {}
    if skin is not None and len(outer):
        sides = sides_of_points(*label_map, mouth), sides_of_nodes(points, mesh.cells, lip)
        carried = _carried(skin, points, outer, sides)
    skin_points, skin_faces = carried.get("skin_points", points), carried.pop("skin_faces", outer)
    centre, cut = skin_points[skin_faces].mean(axis=1), points[faces[(beyond == m.CUT_PLANE).all(axis=1)]]
    roi = _judged(centre, bone, segments, cut, nasion_above_maxilla, tragus_before_mandible, cut_margin)
    return m.PatientModel(
        points=points,
        cells=mesh.cells,
        tissue=mesh.tissue,
        node_type=node_type,
        node_segment=node_segment,
        node_beyond=node_beyond,
        node_normal=_node_normals(boundary, node_beyond),
        interface_kind=_kinds(mesh, boundary, contact),
        skin_faces=skin_faces,
        face_roi=roi,
        bone_points=bone.points,
        bone_normals=bone.normals,
        bone_faces=bone.faces,
        bone_segment=bone.segment,
        segments=segments,
        lip=lip,
        **carried,
    )


def _nodes_beyond(
    boundary: MeshBoundary, nodes: int, segments: int, contact_share: float
) -> tuple[np.ndarray, np.ndarray]:
    """What lies beyond each node (n,) int16, and which nodes (n,) bool touch bone.

    From points on every boundary triangle a ray goes outward to the first label that is not tissue. A node on a cut
    plane, at the border of the volume, is CUT_PLANE; else, if bone makes up more than `contact_share` of the area
    around it, the bone with the largest part; else air.
    """
    faces, areas, beyond = boundary.faces, boundary.areas, boundary.beyond
    codes = np.array([AIR, CRANIUM, *(segment_code(i) for i in range(segments)), m.CUT_PLANE])
    # Area (n, codes) around each node, by what lies beyond.
    share = np.stack([corner_sums(faces, areas * (beyond == code).mean(axis=1), nodes) for code in codes], 1)
    surface = share.sum(axis=1) > 0
    bones = share[:, 1:-1]
    node_beyond = np.full(nodes, m.INTERIOR, np.int16)
    contact = surface & (bones.sum(axis=1) > contact_share * share.sum(axis=1))
    node_beyond[surface] = AIR
    node_beyond[contact] = codes[1:-1][bones[contact].argmax(axis=1)]
    node_beyond[share[:, -1] > 0] = m.CUT_PLANE
    return node_beyond, contact & (node_beyond != m.CUT_PLANE)


def _node_types(
    mesh: TetMesh,
    node_beyond,
    contact,
    bone: BoneSurface,
    pairs,
    label_map: LabelMap,
    sliding_band: float,
    release: float,
) -> tuple[np.ndarray, np.ndarray]:
    """Type and segment (n,) int8 of each node.

    Cut planes and cranium contact are FIXED, contact with a segment MOVING, but SLIDING where a segment that opposes it
    (pairs) is nearer than `sliding_band` (teeth and vestibule). At an osteotomy the surgeon lifts the tissue off:
    contact nearer than `release` to the other bone is FREE [I], and so are both ends of a mesh edge from one bone to
    the other, which could not follow both. So are the cut plane nodes of an element that has no other nodes but contact
    of segments: the tissue goes on beyond the cut; and those of a cut in front of the face, or below within CUT_REACH
    of a segment. All else is FREE, skin and oral surface too.
    """
    points, cut = mesh.points, node_beyond == m.CUT_PLANE
    node_segment = np.where(contact & (node_beyond >= FIRST_SEGMENT), node_beyond - FIRST_SEGMENT, -1).astype(np.int8)
    node_type = np.full(len(points), m.FREE, np.int8)
    node_type[node_segment >= 0] = m.MOVING
    node_type[cut | (node_beyond == CRANIUM)] = m.FIXED
    body = np.where(contact, node_beyond - FIRST_SEGMENT, NO_BODY)  # -1: the cranium
    for i, j in pairs:
        for one, other in ((i, j), (j, i)):
            nodes, target = np.flatnonzero(body == one), bone.points[bone.segment == other]
            if len(nodes) and len(target):
                near = cKDTree(target).query(points[nodes])[0] < sliding_band
                node_type[nodes[near]] = m.SLIDING
    node_type[_open_cut(points, cut, label_map.origin - label_map.spacing / 2, bone)] = m.FREE
    released = _released(points, mesh.cells, body, bone, pairs, release)
    node_type[released], node_segment[released] = m.FREE, -1
    node_type[_torn_cut(mesh.cells, cut, node_segment >= 0)] = m.FREE
    return node_type, node_segment


def _kinds(mesh: TetMesh, boundary: MeshBoundary, contact) -> np.ndarray:
    """Interface (n,) int8 of each node: contact with bone belongs to muscle if muscle owns at least half of the area
    against bone, else to superficial tissue; any other node between both tissues is MUSCLE_SUPERFICIAL."""
    count, beyond = len(mesh.points), boundary.beyond
    bony = ((beyond >= CRANIUM) & (beyond != m.CUT_PLANE)).mean(axis=1) * boundary.areas
    muscle_part = corner_sums(boundary.faces, bony * (boundary.tissue == MUSCLE), count)
    to_muscle = muscle_part >= corner_sums(boundary.faces, bony, count) / 2
    both = _touches(mesh, MUSCLE) & _touches(mesh, SUPERFICIAL)
    kind = np.where(both, m.MUSCLE_SUPERFICIAL, m.NO_INTERFACE)
    return np.where(contact, np.where(to_muscle, m.BONE_MUSCLE, m.BONE_SUPERFICIAL), kind).astype(np.int8)


def _judged(
    centre, bone: BoneSurface, segments, cut, nasion_above: float, tragus_before: float, cut_margin: float
) -> np.ndarray:
    """Which skin triangles (f,) bool, with centres (f, 3) mm, are judged [I].

    Below the nasion, taken as `nasion_above` the top of the maxilla; in front of the tragi, taken as `tragus_before`
    the hindmost mandible; `cut_margin` away from the triangles `cut` (k, 3, 3) mm of cut planes.
    """
    top = nasion_height(bone.points, bone.segment, segments, nasion_above)
    lower = of_segments(bone.segment, segments, "distal", UNCUT, "proximal")
    lower = lower if lower.any() else bone.segment >= 0
    back = bone.points[lower, 1].max(initial=-np.inf) - tragus_before if lower.any() else np.inf
    judged = (centre[:, 2] < top) & (centre[:, 1] < back)
    for places in (cut.mean(axis=1), cut.reshape(-1, 3)):
        if len(places):
            judged &= cKDTree(places).query(centre)[0] > cut_margin
    return judged


def _beyond(points, faces, normals, labels, spacing, origin, reach_mm, gap_mm) -> tuple[np.ndarray, np.ndarray]:
    """Code beyond k points of every triangle (f, k), and the voxel (f, k, 3) where it was met."""
    weights = simplex_points(3, 2)
    starts = weights @ points[faces]
    shape = np.array(labels.shape)
    step = 0.5 * spacing.min()
    code = np.full(starts.shape[:2], -1, np.int16)
    voxel = np.zeros((*code.shape, 3), np.int64)
    air_since = np.full(code.shape, np.inf)
    for distance in np.arange(0.5 * step, reach_mm + gap_mm, step):
        index = np.rint((starts + distance * normals[:, None] - origin) / spacing).astype(int)
        outside = ((index < 0) | (index >= shape)).any(axis=2)
        index = np.clip(index, 0, shape - 1)
        here = np.where(outside, AIR, labels[tuple(np.moveaxis(index, 2, 0))])
        undecided = code < 0
        in_gap = np.isfinite(air_since)
        bony = undecided & (here >= CRANIUM) & (in_gap | (distance <= reach_mm))
        code[bony], voxel[bony] = here[bony], index[bony]
        entered = undecided & ~bony & ~in_gap & (here == AIR) & (distance <= reach_mm)
        air_since[entered], voxel[entered] = distance, index[entered]
        # Past the gap, or in tissue on its far side (the other lip), it was air.
        ended = undecided & ~bony & in_gap & ((distance - air_since > gap_mm) | (here != AIR))
        code[ended] = AIR
    lost = code < 0
    code[lost & np.isfinite(air_since)] = AIR
    lost &= ~np.isfinite(air_since)
    if lost.any():
        # Tissue all the way: the mesh leaves out something thin there. Take what is nearest.
        index = np.clip(np.rint((starts[lost] - origin) / spacing).astype(int), 0, shape - 1)
        hidden = is_tissue(labels)[tuple(index.T)]
        index[hidden] = nearest_voxels(index[hidden], ~is_tissue(labels), spacing)
        code[lost], voxel[lost] = labels[tuple(index.T)], index
    low, high = origin - spacing / 2, origin + spacing * (shape - 0.5)
    tolerance = 1e-6 * spacing
    corners = points[faces]
    flat = (np.abs(corners - low) < tolerance).all(axis=1) | (np.abs(corners - high) < tolerance).all(axis=1)
    code[flat.any(axis=1)] = m.CUT_PLANE
    return code, voxel


def _carried(skin, points, outer, sides) -> dict[str, np.ndarray]:
    """The part of a fine skin (points, faces) that lies on the mesh's outer skin triangles, with its carriers; cut
    where the mesh opens the lips. sides: lip of points (k, 3), and (n,) of each node."""
    (skin_points, skin_faces), (side, node_lips) = skin, sides
    edge, lip = np.linalg.norm(points[outer[:, 0]] - points[outer[:, 1]], axis=1).mean(), side(skin_points)
    spans, whole = np.zeros(skin_faces.shape, bool), len(skin_points)
    between = np.flatnonzero(np.ptp(lip[skin_faces], axis=1))
    if len(between):
        used, strip = np.unique(skin_faces[between], return_inverse=True)
        strip = strip.reshape(-1, 3)
        nodes, _, _ = embed(skin_points[used], strip, points, outer, (lip[used], node_lips), edge)
        spans[between] = bridging(strip, nodes, outer)
    skin_points, skin_faces, lip = cut_between_lips(skin_points, skin_faces, lip, spans, side)
    nodes, weights, distance = embed(skin_points, skin_faces, points, outer, (lip, node_lips), edge)
    faces = skin_faces[(distance[skin_faces] < edge).all(axis=1)]
    # What lies at the cut is of one lip, whatever carries its corners.
    faces = faces[(faces >= whole).any(axis=1) | ~bridging(faces, nodes, outer).any(axis=1)]
    used, faces = np.unique(faces, return_inverse=True)
    return {
        "skin_points": skin_points[used],
        "skin_faces": faces.reshape(-1, 3).astype(np.int32),
        "skin_nodes": nodes[used].astype(np.int32),
        "skin_weights": weights[used],
    }


def _touches(mesh, tissue) -> np.ndarray:
    nodes = np.zeros(len(mesh.points), bool)
    nodes[mesh.cells[mesh.tissue == tissue]] = True
    return nodes


def opposing_pairs(bone, labels, spacing, origin, segments, band: float) -> list[tuple[int, int]]:
    """Pairs of bones, by segment index, with air between them on a tenth of the surface points where they come within
    the band: jaws against each other, neither rami nor pieces of one maxilla. -1, the cranium, is the upper jaw of a
    case whose maxilla is not cut but whose lower jaw is."""
    pairs = []
    upper, lower, ramus = (of_role(segments, *what) for what in (("maxilla",), ("distal", UNCUT), ("proximal",)))
    jaws = [i for i in np.unique(bone.segment[bone.segment >= 0]).tolist() if segments[i] not in ramus]
    if lower and not upper and (bone.segment == -1).any():
        jaws = [-1, *jaws]
    trees = {i: cKDTree(bone.points[bone.segment == i]) for i in jaws}
    along = np.linspace(0.2, 0.8, 7)[:, None]
    for i, j in combinations(jaws, 2):
        if {segment_name(i, segments), segment_name(j, segments)} <= {*upper}:
            continue
        one = trees[i].data
        distance, nearest = trees[j].query(one)
        close = distance < band
        if not close.any():
            continue
        start, end = one[close][:, None], trees[j].data[nearest[close]][:, None]
        index = np.rint((start + along * (end - start) - origin) / spacing).astype(int)
        index = np.clip(index, 0, np.array(labels.shape) - 1)
        through = labels[tuple(np.moveaxis(index, 2, 0))]
        airy = (distance[close] > 2 * spacing.max()) & ((through == AIR).mean(axis=1) > 0.4)
        LOG.debug("bones %d and %d: air between %.0f %% of %d points", i, j, 100 * airy.mean(), len(airy))
        if airy.mean() > 0.1:
            pairs.append((i, j))
    return pairs


def _released(points, cells, body, bone, opposing, release_mm: float) -> np.ndarray:
    """Nodes (n,) bool at an osteotomy: too near to a bone that is neither their own nor opposes it.

    body (n,) segment index of the bone that a node touches, -1 cranium, NO_BODY none.
    """
    released = np.zeros(len(points), bool)
    edges = cells[:, list(combinations(range(4), 2))].reshape(-1, 2)
    opposed = {frozenset(pair) for pair in opposing}
    present = [index for index in np.unique(body) if index != NO_BODY]
    for first, second in combinations(present, 2):
        if frozenset((first, second)) in opposed:
            continue
        for one, two in ((first, second), (second, first)):
            nodes, target = np.flatnonzero(body == one), bone.points[bone.segment == two]
            if len(target):
                released[nodes[cKDTree(target).query(points[nodes])[0] < release_mm]] = True
        bridge = (np.sort(body[edges], axis=1) == sorted((first, second))).all(axis=1)
        released[edges[bridge].ravel()] = True
    return released


def _open_cut(points, cut, low, bone) -> np.ndarray:
    """Nodes (n,) bool on a cut plane, cut (n,), that follow: in front, and below where a moving bone is near.

    low (3,): the lower corner of the volume. What the field of view cuts off there is the tip of the nose or the tissue
    of a chin, which moves; behind, above and beside lies what stays.
    """
    free = np.zeros(len(points), bool)
    index, moving = np.flatnonzero(cut), bone.points[bone.segment >= 0]
    if len(index) and len(moving):
        at = points[index] - low
        below = (at[:, 2] < ON_BORDER) & (cKDTree(moving).query(points[index])[0] < CUT_REACH)
        free[index] = (at[:, 1] < ON_BORDER) | below
        if free.any():
            LOG.warning("the field of view cuts tissue that moves: %d nodes at its border are left free", free.sum())
    return free


def _torn_cut(cells, cut, moving) -> np.ndarray:
    """Nodes (n,) bool on a cut plane, cut (n,), of elements between it and a segment, moving (n,), without a free node.

    Their cut and segment would prescribe the whole element, and so turn it inside out.
    """
    torn = np.zeros(len(cut), bool)
    prescribed = (cut | moving)[cells].all(axis=1) & moving[cells].any(axis=1)
    torn[cells[prescribed]] = True
    return torn & cut


def _skin(faces, beyond, ends, areas, labels, spacing, origin, opening_mm) -> np.ndarray:
    """Triangles (f,) bool of the outer skin: against the air in front of the head that a ball of diameter `opening_mm`
    reaches, the largest connected piece; neither the mouth nor the nasal cavity."""
    # One layer of air in front, because a tightly cropped volume may end at the nose.
    air = np.pad(labels == AIR, ((1, 1), (1, 0), (0, 0)), constant_values=True)
    reach = opening_mm / 2 + spacing.max()
    roomy = signed_distance(air, spacing, 2 * reach) > opening_mm / 2
    roomy[:, 0] = True
    region, _ = ndimage.label(roomy)
    front = region == region[0, 0, 0]
    reached = signed_distance(front, spacing, 2 * reach) > -reach
    reached = reached[1:-1, 1:]
    outer = ((beyond == AIR) & reached[tuple(np.moveaxis(ends, 2, 0))]).mean(axis=1) >= 0.5
    index = np.flatnonzero(outer)
    if len(index) == 0:
        return outer
    # Largest piece by area, over shared edges.
    edges = np.sort(faces[index][:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    _, edge = np.unique(edges, axis=0, return_inverse=True)
    graph = sparse.csr_array((np.ones(len(edge)), (np.repeat(np.arange(len(index)), 3), edge.ravel())))
    _, piece = connected_components(graph @ graph.T, directed=False)
    largest = np.bincount(piece, areas[index]).argmax()
    outer[index[piece != largest]] = False
    return outer


def _node_normals(boundary: MeshBoundary, node_beyond) -> np.ndarray:
    """Outward unit normal (n, 3): area-weighted over the triangles that see what lies beyond the node; zero inside."""
    count, areas = len(node_beyond), boundary.areas
    total, every = np.zeros((count, 3)), np.zeros((count, 3))
    for corner in range(3):
        nodes = boundary.faces[:, corner]
        same = (boundary.beyond == node_beyond[nodes][:, None]).mean(axis=1) * areas
        np.add.at(total, nodes, boundary.normals * same[:, None])
        np.add.at(every, nodes, boundary.normals * areas[:, None])
    weak = np.linalg.norm(total, axis=1) < 1e-9
    total[weak] = every[weak]
    length = np.linalg.norm(total, axis=1, keepdims=True)
    return total / np.where(length > 0, length, 1)
