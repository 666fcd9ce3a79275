"""Skin hangs on its own lip, wherever a mesh opens the slit."""

import numpy as np
import pytest

from pinnochio.geometry.triangles import face_normals
from pinnochio.meshing.embedding import bridging, cut_between_lips, embed
from pinnochio.meshing.interfaces import opposing_pairs
from pinnochio.meshing.lip_sides import sides_of_nodes, sides_of_points
from pinnochio.meshing.lips import bite
from pinnochio.meshing.tetrahedralize import tetrahedralize
from pinnochio.model.labels import AIR, SUPERFICIAL
from pinnochio.model.patient import LOWER_LIP, NOT_LIP, UPPER_LIP
from pinnochio.model.surfaces import bone_surface
from tests.helpers.heads import ORIGIN, SEGMENTS, block_face

SLIT = 34.0  # mm above the corner of the block face: the middle of its slit


def sheet(low, high, step):
    """A face in the plane y = 0, outward to the front: points (n, 3) mm and triangles (k, 3) from z low to high."""
    x, z = np.arange(0, 20.1, step), np.linspace(low, high, int(round((high - low) / step)) + 1)
    points = np.array([(a, 0, b) for b in z for a in x])
    first = np.array([row * len(x) + i for row in range(len(z) - 1) for i in range(len(x) - 1)])
    square = first[:, None] + [0, 1, len(x), len(x) + 1]
    return points, np.concatenate([square[:, [0, 1, 2]], square[:, [1, 3, 2]]])


def test_a_point_of_the_upper_lip_hangs_on_it_though_the_mesh_opens_the_slit_higher_up():
    upper, lower = sheet(3, 15, 4), sheet(-9, 3, 4)  # the mesh parts at 3 mm, the skin at 0
    points, faces = np.vstack([upper[0], lower[0]]), np.vstack([upper[1], lower[1] + len(upper[0])])
    nodes = np.repeat([UPPER_LIP, LOWER_LIP], [len(upper[0]), len(lower[0])])
    skin, skin_faces = sheet(-5, 5, 1)
    skin[:, 1] -= 0.1
    lips = np.where(skin[:, 2] > 0, UPPER_LIP, LOWER_LIP)
    between = (skin[:, 2] > 0) & (skin[:, 2] < 3)
    carriers, weights, distance = embed(skin, skin_faces, points, faces)
    assert (nodes[carriers[between]] == LOWER_LIP).all() and between.sum() > 30
    parted, weights, distance = embed(skin, skin_faces, points, faces, (lips, nodes))
    assert (nodes[parted] == lips[:, None]).all()
    np.testing.assert_allclose(weights.sum(axis=1), 1)
    np.testing.assert_allclose(distance[between], np.hypot(0.1, 3 - skin[between, 2]))
    # The skin is opened at its own slit.
    for carried, low, high in ((carriers, 2, 4), (parted, 0, 1)):
        rows = skin[skin_faces[bridging(skin_faces, carried, faces).any(axis=1)], 2]
        assert len(rows) > 30 and rows.min() == low and rows.max() == high
    # Even where its own lip faces the other way, as the sides of a slit do.
    turned = np.vstack([upper[1][:, ::-1], lower[1] + len(upper[0])])
    assert (nodes[embed(skin, skin_faces, points, turned)[0][between]] == LOWER_LIP).all()
    parted, _, distance = embed(skin, skin_faces, points, turned, (lips, nodes))
    assert (nodes[parted[between]] == UPPER_LIP).all() and np.isfinite(distance[between]).all()
    near = embed(skin, skin_faces, points, faces, (lips, nodes), reach=1.5)[0]
    assert (nodes[near[skin[:, 2] == 2]] == UPPER_LIP).all() and (nodes[near[skin[:, 2] == 1]] == LOWER_LIP).all()
    # What is unknown hangs on what is nearest, and so does all where the two lips are one.
    for sides in ((lips * 0, nodes), (lips, nodes * 0)):
        np.testing.assert_array_equal(embed(skin, skin_faces, points, faces, sides)[0], carriers)
    whole, whole_faces = sheet(-9, 15, 4)
    sides = lips, np.where(whole[:, 2] > 3, UPPER_LIP, LOWER_LIP)
    nearest = embed(skin, skin_faces, whole, whole_faces)[0]
    np.testing.assert_array_equal(embed(skin, skin_faces, whole, whole_faces, sides)[0], nearest)


def test_sealed_skin_is_cut_between_the_lips_where_the_mesh_opens_them():
    points, faces = sheet(-5, 5, 1)
    lip = np.where(points[:, 2] > 0, UPPER_LIP, LOWER_LIP)
    edges = np.stack([faces, np.roll(faces, -1, axis=1)], axis=2)

    def side(places):  # the lips meet on a slope
        return np.where(places[:, 2] > 0.02 * places[:, 0] + 0.25, UPPER_LIP, LOWER_LIP)

    spans = (points[edges, 0] > 4.5).all(axis=2)  # beyond the corner of the mouth they are one
    cut, parts, lips = cut_between_lips(points, faces, lip, spans, side)
    np.testing.assert_array_equal(cut[: len(points)], points)
    upper, lower = (np.flatnonzero(lips[len(points) :] == code) + len(points) for code in (UPPER_LIP, LOWER_LIP))
    np.testing.assert_array_equal(cut[upper], cut[lower])  # the lips touch
    assert len(upper) > 30 and np.abs(cut[upper, 2] - 0.02 * cut[upper, 0] - 0.25).max() < 0.06
    mixed = (lips[parts] != lips[parts][:, :1]).any(axis=1)
    assert cut[parts[mixed], 0].min() == 0 and cut[parts[mixed], 0].max() <= 5.1
    assert face_normals(cut, parts)[0][:, 1].max() < -0.99  # none is turned over
    assert face_normals(cut, parts)[1].sum() == pytest.approx(face_normals(points, faces)[1].sum())
    count = np.unique(np.sort(parts[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)), axis=0, return_counts=True)[1]
    assert count.max() == 2 and (count == 1).sum() == 61 + 2 * 31  # the rim, and the edges of both lips
    for none in (spans & False, spans & (lip[faces] == NOT_LIP)):
        assert cut_between_lips(points, faces, lip, none, side)[1] is faces


def mouth_of(labels):
    bone = bone_surface(labels, np.ones(3), ORIGIN, SEGMENTS)
    return bite(bone, opposing_pairs(bone, labels, np.ones(3), ORIGIN, SEGMENTS, 18.0), 18.0)


def test_the_slit_of_the_label_map_parts_the_tissue():
    labels = block_face()[0]
    labels[20:36, 8:18, 62:64] = AIR  # neither a nostril nor a fold between lip and chin is a slit
    labels[12:44, 8:12, 24:27] = AIR
    mouth = mouth_of(labels)
    points = ORIGIN + np.stack(np.meshgrid([15.0, 28, 40], [8.0, 14], np.arange(22, 47)), axis=-1).reshape(-1, 3)
    side, height = sides_of_points(labels, np.ones(3), ORIGIN, mouth)(points), (points - ORIGIN)[:, 2]
    assert (side[height > SLIT] == UPPER_LIP).all() and (side[height < SLIT] == LOWER_LIP).all()
    beside = ORIGIN + [[28.0, 10, 70], [28, 10, 60], [28, 10, 5], [28, 10, 500]]
    assert (sides_of_points(labels, np.ones(3), ORIGIN, mouth)(beside) == NOT_LIP).all()
    assert (sides_of_points(labels, np.ones(3), ORIGIN, mouth[:0])(points) == NOT_LIP).all()
    labels = block_face()[0]
    labels[8:48, 8:22, int(SLIT)] = SUPERFICIAL
    assert (sides_of_points(labels, np.ones(3), ORIGIN, mouth)(points) == NOT_LIP).all()


def test_the_slit_of_a_mesh_parts_its_nodes():
    labels = block_face()[0]
    mesh = tetrahedralize(labels, np.ones(3), ORIGIN, 1200)
    place, centre = mesh.points - ORIGIN, (mesh.points - ORIGIN)[mesh.cells].mean(axis=1)
    # Nodes of the slit are told by their cells: both sides share a place in the end.
    above = np.zeros(len(place), bool)
    above[mesh.cells[centre[:, 2] > SLIT]] = True
    slit = (np.abs(place[:, 2] - SLIT) < 1) & (place[:, 0] > 12) & (place[:, 0] < 44)
    lip = np.where(slit, np.where(above, UPPER_LIP, LOWER_LIP), NOT_LIP)
    side = sides_of_nodes(mesh.points, mesh.cells, lip)
    near = (np.abs(place[:, 2] - SLIT) < 8) & (place[:, 0] > 16) & (place[:, 0] < 40)
    assert (side[near] == np.where(above, UPPER_LIP, LOWER_LIP)[near]).all() and near.sum() > 60
    assert (side[np.abs(place[:, 2] - SLIT) > 25] == NOT_LIP).all()
    assert (sides_of_nodes(mesh.points, mesh.cells, lip * 0) == NOT_LIP).all()
