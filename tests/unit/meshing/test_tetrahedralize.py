"""The lattice mesher: shape, conformity, flat cuts, slits, noise, node target, determinism, and two heads."""

import hashlib

import numpy as np
import pytest
from scipy import ndimage, sparse
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from pinnochio.errors import InputError
from pinnochio.geometry.mesh_topology import adjacency
from pinnochio.meshing.fields import is_tissue, signed_distance, without_specks
from pinnochio.meshing.tetrahedralize import tetrahedralize
from pinnochio.model.labels import AIR, CRANIUM, MUSCLE, SUPERFICIAL
from tests.helpers.virtual_heads import virtual_head

ORIGIN = np.array([-10.0, 4.0, 7.0])


def ball(spacing=(1.0, 1.0, 1.0), radius=28.0, core=18.0, margin=5.0):
    """Ball of superficial tissue with a muscle core around the point (0, 0, 0); labels, spacing, origin."""
    spacing = np.array(spacing)
    count = np.ceil(2 * (radius + margin) / spacing).astype(int)
    origin = -(count - 1) / 2 * spacing
    place = np.indices(count).T.swapaxes(0, 2) * spacing + origin
    r = np.linalg.norm(place, axis=-1)
    labels = np.where(r < core, MUSCLE, np.where(r < radius, SUPERFICIAL, AIR)).astype(np.uint8)
    return labels, spacing, origin


def slab():
    """Tissue that fills the volume: muscle below an inclined plane, superficial tissue above."""
    i, j, k = np.indices((46, 40, 30))
    labels = np.where(k < 12 + 0.2 * i, MUSCLE, SUPERFICIAL).astype(np.uint8)
    return labels, np.ones(3), ORIGIN


def slit_block(width=1):
    """Tissue block with a horizontal slit from its front to two thirds of its depth, open to air in front."""
    labels = np.full((44, 44, 40), SUPERFICIAL, np.uint8)
    labels[:, :6] = AIR
    labels[6:38, :32, 20 : 20 + width] = AIR
    return labels, np.ones(3), ORIGIN


def noisy(labels, share, seed=0):
    """Labels with a share of the voxels set to a random label."""
    rng = np.random.default_rng(seed)
    flip = rng.random(labels.shape) < share
    codes = rng.choice([AIR, SUPERFICIAL, MUSCLE, CRANIUM], labels.shape).astype(np.uint8)
    return np.where(flip, codes, labels)


def edge_uses(faces):
    edges = np.sort(faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    return np.unique(edges, axis=0, return_counts=True)[1]


def check(mesh, target):
    """What every mesh promises."""
    assert mesh.points.dtype == np.float64 and mesh.cells.dtype == np.int32 and mesh.tissue.dtype == np.int8
    assert np.array_equal(np.unique(mesh.cells), np.arange(len(mesh.points)))
    assert mesh.volumes().min() > 0
    assert mesh.dihedral_angles().min() >= 12
    assert abs(len(mesh.points) - target) <= 0.1 * target
    faces, _ = mesh.boundary_faces()
    assert (edge_uses(faces) == 2).all()
    first, second = adjacency(mesh.cells)
    graph = sparse.coo_array((np.ones(len(first)), (first // 4, second // 4)), shape=[len(mesh.cells)] * 2)
    assert connected_components(graph)[0] == 1


def tissue_volume(mesh, code):
    return mesh.volumes()[mesh.tissue == code].sum()


def across(mesh, labels, spacing, origin, low, high):
    """How the mesh crosses a slit, in a box (mm) that the slit cuts in two.

    The sides are the two largest pieces of tissue voxels in the box; the mesh falls into pieces of cells joined by
    faces, and each side has the piece that fills most of it. Returns the number of nodes that these two pieces share
    (all, if they are one) and the larger share of a side that the other side's piece fills.
    """
    first = np.maximum(np.floor((np.array(low) - origin) / spacing).astype(int), 0)
    last = np.ceil((np.array(high) - origin) / spacing).astype(int)
    piece, _ = ndimage.label(is_tissue(labels[tuple(slice(a, b) for a, b in zip(first, last, strict=True))]))
    sides = np.argsort(-np.bincount(piece.ravel())[1:])[:2] + 1
    index = np.argwhere(np.isin(piece, sides))
    centres = mesh.points[mesh.cells].mean(axis=1)
    inside = ((centres > low) & (centres < high)).all(axis=1)
    cells, volume = mesh.cells[inside], mesh.volumes()[inside]
    nearest = cKDTree((index + first) * spacing + origin).query(centres[inside])[1]
    upper = piece[tuple(index[nearest].T)] == sides[0]
    assert upper.sum() > 5 and (~upper).sum() > 5
    a, b = adjacency(cells)
    _, group = connected_components(sparse.coo_array((np.ones(len(a)), (a // 4, b // 4)), shape=[len(cells)] * 2))
    parts = [np.bincount(group, volume * side) / volume[side].sum() for side in (upper, ~upper)]
    one, two = (part.argmax() for part in parts)
    return len(np.intersect1d(cells[group == one], cells[group == two])), max(parts[0][two], parts[1][one])


def test_signed_distance_is_half_way_between_voxels():
    inside = np.zeros((9, 5, 5), bool)
    inside[:4] = True
    assert np.allclose(signed_distance(inside, np.array([2.0, 1, 1]), 20.0)[:, 2, 2], 7.0 - 2 * np.arange(9))


@pytest.mark.parametrize("reach", [4.0, 100.0])
def test_signed_distance_is_the_mean_of_the_ways_to_both_sides_of_a_surface(reach):
    inside = ndimage.gaussian_filter(np.random.default_rng(3).normal(size=(40, 33, 27)), 3) > 0
    spacing, expected = np.array([0.7, 1.0, 2.2]), 0
    for side in (inside, ~inside):
        outermost = side & ~ndimage.binary_erosion(side, border_value=1)
        expected = expected + ndimage.distance_transform_edt(~outermost, sampling=spacing) / 2
    expected = np.where(inside, 1, -1) * np.minimum(expected, reach)
    assert np.abs(signed_distance(inside, spacing, reach) - expected).max() < 1e-5


def test_specks_go_and_sheets_stay():
    labels = np.full((20, 20, 20), SUPERFICIAL, np.uint8)
    labels[3:5, 3:5, 3:5] = AIR
    labels[:, :, 10] = AIR
    labels[15, 15, 15] = MUSCLE
    cleaned = without_specks(labels)
    assert (cleaned[:, :, 10] == AIR).all()
    cleaned[:, :, 10] = SUPERFICIAL
    assert (cleaned == SUPERFICIAL).all()


@pytest.mark.parametrize("target", [1500, 5000, 12000])
def test_ball(target):
    labels, spacing, origin = ball()
    mesh = tetrahedralize(labels, spacing, origin, target)
    check(mesh, target)
    faces, _ = mesh.boundary_faces()
    nodes = np.unique(faces)
    assert len(nodes) - len(edge_uses(faces)) + len(faces) == 2
    radius = np.linalg.norm(mesh.points[nodes], axis=1)
    assert np.abs(radius - 28).mean() < 0.25
    exact = 4 / 3 * np.pi * np.array([18.0**3, 28.0**3 - 18.0**3])
    volumes = [tissue_volume(mesh, MUSCLE), tissue_volume(mesh, SUPERFICIAL)]
    assert volumes == pytest.approx(exact, rel=0.06 if target < 3000 else 0.03)
    muscle, superficial = (np.unique(mesh.cells[mesh.tissue == code]) for code in (MUSCLE, SUPERFICIAL))
    between = np.linalg.norm(mesh.points[np.intersect1d(muscle, superficial)], axis=1)
    assert np.abs(between - 18).mean() < 0.35


def test_anisotropic_voxels():
    labels, spacing, origin = ball(spacing=(0.7, 1.0, 2.2))
    mesh = tetrahedralize(labels, spacing, origin, 2000)
    check(mesh, 2000)
    radius = np.linalg.norm(mesh.points[np.unique(mesh.boundary_faces()[0])], axis=1)
    assert np.abs(radius - 28).mean() < 0.3


@pytest.mark.parametrize("shift", [(0, 0, 0), (1.3, -0.9, 2.0)])
def test_slab_has_flat_cut_faces(shift):
    labels, spacing, origin = slab()
    mesh = tetrahedralize(labels, spacing, origin, 2000, shift=shift)
    check(mesh, 2000)
    low, high = origin - 0.5, origin - 0.5 + labels.shape
    corners = mesh.points[mesh.boundary_faces()[0]]
    on_plane = ((corners == low).all(axis=1) | (corners == high).all(axis=1)).any(axis=1)
    assert on_plane.all()
    assert mesh.volumes().sum() == pytest.approx(labels.size, rel=1e-12)
    for code in (MUSCLE, SUPERFICIAL):
        assert tissue_volume(mesh, code) == pytest.approx((labels == code).sum(), rel=0.02)


def test_shift_gives_other_nodes():
    labels, spacing, origin = slab()
    one, two = (tetrahedralize(labels, spacing, origin, 1500, shift=s) for s in ((0, 0, 0), (1.7, 1.7, 1.7)))
    inside = [
        ((m.points > origin + 8) & (m.points < origin + np.array(labels.shape) - 9)).all(axis=1) for m in (one, two)
    ]
    distance, _ = cKDTree(one.points[inside[0]]).query(two.points[inside[1]])
    assert (distance > 0.3).mean() > 0.8


@pytest.mark.parametrize("turn", [-12.0, 10.0])
def test_a_turned_lattice_keeps_the_cuts_flat_and_lies_otherwise(turn):
    """A slab cut behind, below and above, with air in front and beside it."""
    labels = np.zeros((60, 50, 30), np.uint8)
    labels[12:48, 14:] = SUPERFICIAL
    spacing, origin = np.ones(3), np.array([-30.0, -50, 0])
    straight, turned = (tetrahedralize(labels, spacing, origin, 2500, turn=angle) for angle in (0.0, turn))
    check(turned, 2500)
    assert turned.volumes().sum() == pytest.approx((labels > 0).sum(), rel=0.03)
    for axis, plane in ((1, -0.5), (2, -0.5), (2, 29.5)):
        near = np.abs(turned.points[:, axis] - plane) < 0.5
        assert near.sum() > 30 and np.abs(turned.points[near, axis] - plane).max() < 1e-9
    inner = [m.points[(np.abs(m.points - [0, -22, 14.5]) < [14, 8, 10]).all(axis=1)] for m in (straight, turned)]
    assert (cKDTree(inner[0]).query(inner[1])[0] > 0.3).mean() > 0.7


@pytest.mark.parametrize("target", [1500, 6000])
@pytest.mark.parametrize("width", [1, 3])
def test_slit_is_opened(target, width):
    labels, spacing, origin = slit_block(width)
    box = origin + [13, 8, 10], origin + [31, 25, 30 + width]
    mesh = tetrahedralize(labels, spacing, origin, target)
    check(mesh, target)
    shared, strayed = across(mesh, labels, spacing, origin, *box)
    assert shared == 0 and strayed < 0.1
    whole = labels.copy()
    whole[:, 6:] = SUPERFICIAL
    closed = tetrahedralize(whole, spacing, origin, target)
    shared, strayed = across(closed, labels, spacing, origin, *box)
    assert shared > 20 and strayed == pytest.approx(1)


def test_slit_survives_flipped_voxels():
    labels, spacing, origin = slit_block(2)
    mesh = tetrahedralize(noisy(labels, 0.01), spacing, origin, 2000)
    check(mesh, 2000)
    shared, strayed = across(mesh, labels, spacing, origin, origin + [13, 8, 10], origin + [31, 25, 31])
    assert shared == 0 and strayed < 0.15


def test_flipped_voxels_change_little():
    labels, spacing, origin = ball()
    mesh = tetrahedralize(noisy(labels, 0.03), spacing, origin, 2500)
    check(mesh, 2500)
    radius = np.linalg.norm(mesh.points[np.unique(mesh.boundary_faces()[0])], axis=1)
    assert np.abs(radius - 28).mean() < 0.4
    assert mesh.volumes().sum() == pytest.approx(4 / 3 * np.pi * 28**3, rel=0.04)


def test_thin_sheet_keeps_skin_and_bone_apart():
    """A sheet thinner than the lattice over a ball of bone has no holes: no boundary node sees bone and air."""
    labels, spacing, origin = ball(radius=30.0, core=26.5)
    labels[labels == MUSCLE] = CRANIUM
    mesh = tetrahedralize(labels, spacing, origin, 600)
    faces, _ = mesh.boundary_faces()
    assert (edge_uses(faces) == 2).all()
    count = len(np.unique(faces)) - len(edge_uses(faces)) + len(faces)
    assert count == 4  # two closed spheres
    assert tissue_volume(mesh, SUPERFICIAL) == pytest.approx((labels == SUPERFICIAL).sum(), rel=0.25)


def test_same_input_gives_the_same_bytes(tmp_path):
    labels, spacing, origin = slit_block()
    sums = set()
    for name in ("a.vtu", "b.vtu"):
        tetrahedralize(noisy(labels, 0.01), spacing, origin, 1200).write(tmp_path / name)
        sums.add(hashlib.sha256((tmp_path / name).read_bytes()).hexdigest())
    assert len(sums) == 1


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"labels": np.zeros((9, 9, 9), np.uint8)}, "no soft tissue"),
        ({"labels": np.ones((9, 9), np.uint8)}, "axes"),
        ({"spacing": (1, 1, -1)}, "positive"),
        ({"spacing": (1, np.nan, 1)}, "finite"),
        ({"target_nodes": 4}, "nodes"),
        ({"minimum_dihedral": 50}, "dihedral"),
    ],
)
def test_bad_input(change, words):
    arguments = {"labels": np.ones((9, 9, 9), np.uint8), "spacing": (1, 1, 1), "origin": (0, 0, 0), "target_nodes": 100}
    with pytest.raises(InputError, match=words):
        tetrahedralize(**(arguments | change))


@pytest.mark.parametrize("deformity", ["class_iii", pytest.param("open_bite", marks=pytest.mark.full)])
def test_virtual_head(deformity):
    head = virtual_head(deformity, 1.0)
    mesh = tetrahedralize(head.labels, head.spacing, head.origin, 3000)
    check(mesh, 3000)
    stomion = (head.landmarks["labrale_superius"] + head.landmarks["labrale_inferius"]) / 2
    box = stomion + [-12, -6, -7], stomion + [12, 9, 7]
    shared, strayed = across(mesh, head.labels, head.spacing, head.origin, *box)
    assert shared == 0 and strayed < 0.1
