"""Lip nodes on the block face, whose slit is known, and on none where there is no mouth."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import ndimage

from pinnochio.meshing.interfaces import label_interfaces
from pinnochio.meshing.lips import bite, lip_nodes
from pinnochio.meshing.tetrahedralize import tetrahedralize
from pinnochio.model import patient as m
from pinnochio.model.labels import AIR, SUPERFICIAL
from pinnochio.model.patient import PatientModel
from pinnochio.model.surfaces import bone_surface
from tests.helpers.heads import ORIGIN, SEGMENTS, block_face
from tests.helpers.patients import squares


def labelled(labels, nodes=2500):
    mesh = tetrahedralize(labels, np.ones(3), ORIGIN, nodes)
    bone = bone_surface(labels, np.ones(3), ORIGIN, SEGMENTS)
    return label_interfaces(mesh, labels, np.ones(3), ORIGIN, SEGMENTS, bone)


@pytest.fixture(scope="module")
def folded():
    """The block face with a nostril above its mouth, a fold below the chin and a pocket beside the slit."""
    labels, _, _ = block_face()
    labels[20:36, 8:18, 62:64] = AIR
    labels[8:48, 8:18, 5] = AIR
    labels[12:16, 8:12, 29] = AIR
    return labelled(labels)


@pytest.mark.parametrize("nodes", [1200, 2500])
def test_lips_line_the_slit(nodes):
    model = labelled(block_face()[0], nodes)
    place = model.points - ORIGIN
    for lip, side in ((m.UPPER_LIP, 1), (m.LOWER_LIP, -1)):
        nodes = place[model.lip == lip]
        assert len(nodes) > 12
        assert (np.abs(nodes[:, 2] - 34 - side * 0.5) < 1.2).all()
        assert nodes[:, 0].min() > 6 and nodes[:, 0].max() < 49 and np.ptp(nodes[:, 0]) > 25
        assert np.ptp(nodes[:, 1]) > 9  # from the front to the teeth
    assert (model.node_type[model.lip > 0] == m.FREE).all()
    # Each lip lies above the other: upper nodes belong to cells above the slit.
    centre = place[model.cells].mean(axis=1)[:, 2]
    for lip, side in ((m.UPPER_LIP, 1), (m.LOWER_LIP, -1)):
        assert (side * (centre[(model.lip[model.cells] == lip).any(axis=1)] - 34) > -0.5).all()


def test_nostrils_folds_and_pockets_are_no_lips(folded):
    z = (folded.points - ORIGIN)[:, 2]
    assert (np.abs(z[folded.lip > 0] - 34) < 2).all()
    assert (folded.lip == m.UPPER_LIP).sum() > 12 and (folded.lip == m.LOWER_LIP).sum() > 12
    # They are there: airy nodes that face each other.
    assert ((folded.node_beyond == AIR) & (np.abs(z - 63) < 2)).sum() > 8
    assert ((folded.node_beyond == AIR) & (np.abs(z - 5) < 1)).sum() > 8


def test_no_slit_or_no_bite_no_lips():
    labels, _, _ = block_face()
    labels[8:48, 8:22, 34] = SUPERFICIAL
    labels[20:36, 8:18, 62:64] = AIR
    assert not labelled(labels, 1200).lip.any()
    labels, _, _ = block_face()
    labels[ndimage.binary_dilation(labels == 12) & (labels != SUPERFICIAL)] = 10  # one bone, no mandible
    labels[labels >= 11] = 10
    assert not labelled(labels, 1200).lip.any()


def sheets(corner, size, gap=1.0):
    """Two flat sheets that face each other, the upper first: points and outward faces; corner (3,), size (2,) mm."""
    grid = np.stack(np.meshgrid(*(np.arange(0, s + 1, 3.0) for s in size), indexing="ij"), -1)
    number = np.arange(grid[..., 0].size).reshape(grid.shape[:2])
    up, flat = squares(number), grid.reshape(-1, 2)
    points = [np.column_stack([flat, np.full(len(flat), z)]) + corner for z in (gap / 2, -gap / 2)]
    return np.vstack(points), np.vstack([up[:, ::-1], up + len(flat)])


def test_what_makes_a_face_a_lip():
    mouth = np.column_stack([np.linspace(-20, 20, 9), np.zeros(9), np.zeros(9)])
    parts = {
        "slit": sheets([-15, -12, 0], (30, 12)),
        "pocket": sheets([-3, -12, 8], (6, 6)),
        "nostril": sheets([-15, -12, 26], (30, 12)),
        "cheek": sheets([-15, 16, 0], (30, 12)),
        "gap": sheets([-15, -12, -15], (30, 12), gap=6.0),
    }
    start = np.cumsum([0] + [len(points) for points, _ in parts.values()])
    points = np.vstack([points for points, _ in parts.values()])
    faces = np.vstack([faces + first for (_, faces), first in zip(parts.values(), start[:-1], strict=True)])
    of = dict(zip(parts, (slice(a, b) for a, b in zip(start[:-1], start[1:], strict=True)), strict=True))
    airy, on_bone = np.ones(len(faces), bool), np.zeros(len(points), bool)
    lip = lip_nodes(points, faces, airy, on_bone, mouth)
    half = (start[1] - start[0]) // 2
    assert (lip[of["slit"]][:half] == m.UPPER_LIP).all() and (lip[of["slit"]][half:] == m.LOWER_LIP).all()
    for name in ("pocket", "nostril", "cheek", "gap"):
        assert not lip[of[name]].any(), name
    # A wider reach takes the gap too; what is on bone, or has no air beyond, is no lip.
    wide = lip_nodes(points, faces, airy, on_bone, mouth, reach_mm=7.0)
    assert wide[of["gap"]].all()
    on_bone[:half] = True
    some = lip_nodes(points, faces, airy, on_bone, mouth)
    assert not some[:half].any()
    assert not lip_nodes(points, faces, ~airy, on_bone, mouth).any()
    assert not lip_nodes(points, faces, airy, on_bone, mouth[:0]).any()


def test_lips_and_the_muscles_source_are_kept_in_the_file(folded, tmp_path):
    replace(folded, muscle="derived").write(tmp_path / "model.h5")
    read = PatientModel.read(tmp_path / "model.h5")
    np.testing.assert_array_equal(read.lip, folded.lip)
    assert read.muscle == "derived"
    assert folded.lip.dtype == np.int8
    without = {name: value for name, value in vars(folded).items() if name != "lip"}
    assert not PatientModel(**without).lip.any() and PatientModel(**without).lip.shape == folded.lip.shape


def test_the_bite_lies_between_the_jaws():
    labels, _, _ = block_face()
    bone = bone_surface(labels, np.ones(3), ORIGIN, SEGMENTS)
    middles = bite(bone, [(0, 1)], 18.0) - ORIGIN
    assert len(middles) > 20 and np.abs(middles[:, 2] - 34.5).max() < 6.5
    assert bite(bone, [], 18.0).shape == (0, 3)
