"""One head in every format, orientation, spacing and place comes in as the same head."""

from itertools import permutations, product

import numpy as np
import pytest
import pyvista as pv
import trimesh
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from pinnochio.errors import InputError
from pinnochio.geometry.closed_surfaces import voxelised
from pinnochio.importing.cohort import read_cases
from pinnochio.importing.segmentation import read_segmentation
from pinnochio.meshing.tetrahedralize import tetrahedralize
from pinnochio.model.labels import internal_codes
from pinnochio.model.surfaces import bone_surface, contour, skin_surface
from tests.helpers.dicom import save_dicom_seg
from tests.helpers.tools import write, write_seg_nrrd

SEGMENTS = ("lefort1", "mandible")
STRUCTURES = tuple(internal_codes(SEGMENTS))
CODES = internal_codes(SEGMENTS)
VALUES = {name: 3 + 5 * number for number, name in enumerate(STRUCTURES)}
NAMES = dict(zip(STRUCTURES, ("Fat and skin", "Muscle", "Skull", "Le Fort I", "Mandible"), strict=True))
NODES = 1000


def solids(points):
    """Which of `points` (..., 3) mm lie in each structure; it covers those before it. No symmetry of any kind."""
    points = points.astype(np.float32)

    def ball(centre, radii):
        return sum(((points[..., axis] - centre[axis]) / radii[axis]) ** 2 for axis in range(3)) < 1

    way = points / np.array([26, 29, 33], np.float32)
    length = np.maximum(np.linalg.norm(way, axis=-1), 1e-6)
    nose, ear = (
        height * np.exp(-sum((way[..., axis] / length - place[axis]) ** 2 for axis in range(3)) / 0.4**2)
        for height, place in ((0.3, (0.15, -0.98, -0.1)), (0.25, (0.94, 0.3, 0.15)))
    )
    head = length < 1 + nose + ear
    return {
        "superficial": head,
        "muscle": ball((3, -3, -8), (18, 19, 18)),
        "cranium": ball((-1, 4, 12), (11, 12, 7)),
        "lefort1": ball((-6, -9, -3), (8, 8, 5)),
        "mandible": ball((5, -6, -17), (9, 7, 6)),
    }


def codes_at(points):
    labels = np.zeros(points.shape[:-1], np.uint8)
    for name, inside in solids(points).items():
        labels[inside] = CODES[name]
    return labels


MARGIN = 9.0  # mm of air, more than the edge of a lattice cell
LOW, HIGH = np.array([-26.0, -38.0, -33.0]), np.array([33.0, 30.0, 33.0])


def grid(direction, spacing, place, shift=(0.0, 0.0, 0.0)):
    """Voxel centres (nx, ny, nz, 3) mm of a grid round a head at `place`, relative to it, and the grid's origin."""
    corners = np.array(list(product(*zip(LOW, HIGH, strict=True)))) @ direction
    low = corners.min(axis=0) - MARGIN - np.asarray(shift) * spacing
    size = np.ceil((corners.max(axis=0) + MARGIN - low) / spacing).astype(int) + 1
    index = np.moveaxis(np.indices(size), 0, -1)
    return (low + index * spacing) @ direction.T, low @ direction.T + place


def directions():
    """The 48 ways in which voxel axes can lie along the body's."""
    for order in permutations(range(3)):
        for signs in product((1.0, -1.0), repeat=3):
            yield np.eye(3)[:, order] * signs


def write_head(path, suffix, direction, spacing, place, shift=(0.0, 0.0, 0.0)):
    points, origin = grid(direction, spacing, place, shift=shift)
    frame = (direction, spacing, origin)
    if suffix != "seg.nrrd":
        lookup = np.zeros(20, np.int16)
        for name, code in CODES.items():
            lookup[code] = VALUES[name]
        write(path, lookup[codes_at(points)], None, *frame)
        return VALUES
    # Solid structures that overlap, as they are painted: the head in one layer, muscle and bones in two others.
    layer_of = {"superficial": 0, "muscle": 1, "cranium": 2, "lefort1": 2, "mandible": 2}
    layers = np.zeros((3, *points.shape[:-1]), np.uint8)
    for name, inside in solids(points).items():
        layers[layer_of[name]][inside] = VALUES[name]
    write_seg_nrrd(path, layers, [(NAMES[name], VALUES[name], layer_of[name]) for name in reversed(STRUCTURES)], *frame)
    return NAMES


def surfaces(labels, spacing, origin):
    """Skin and bones of a head, pv.PolyData by name."""
    bone = bone_surface(labels, spacing, origin, SEGMENTS)
    parts = {name: bone.part(index) for index, name in enumerate(("cranium", *SEGMENTS), start=-1)}
    polydata = {name: pv.PolyData.from_regular_faces(part.points, part.faces) for name, part in parts.items()}
    return polydata | {"skin": pv.PolyData.from_regular_faces(*skin_surface(labels, spacing, origin))}


def outside(labels, spacing, origin):
    """Outer boundary of the tetrahedral mesh."""
    mesh = tetrahedralize(labels, spacing, origin, NODES)
    parts = trimesh.Trimesh(mesh.points, mesh.boundary_faces()[0], process=False).split(only_watertight=False)
    return pv.wrap(max(parts, key=lambda part: part.area))


def gap(one, other, share=100):
    """Distance in mm within which `share` % of the vertices of either surface lie to the other surface."""
    ways = (a.compute_implicit_distance(b)["implicit_distance"] for a, b in ((one, other), (other, one)))
    return max(np.percentile(np.abs(way), share) for way in ways)


@pytest.fixture(scope="module")
def upright():
    points, origin = grid(np.eye(3), np.ones(3), np.zeros(3))
    return codes_at(points), np.ones(3), origin


@pytest.fixture(scope="module")
def reference(upright):
    return surfaces(*upright)


@pytest.fixture(scope="module")
def reference_mesh(upright):
    return outside(*upright)


def check_surfaces(head, place, reference):
    """Skin and bones of what came in are the reference's within the diagonal of a voxel."""
    assert head.labels.dtype == np.uint8 and set(np.unique(head.labels)) == {0, *CODES.values()}
    for name, surface in surfaces(head.labels, head.spacing, head.origin - place).items():
        assert gap(surface, reference[name]) < np.linalg.norm(head.spacing), name


def check_mesh(head, place, reference_mesh):
    """The outside of the mesh of what came in is the reference's within the diagonal of a voxel.

    That is, 95 % of it: two lattices over one head differ by more at single nodes, and the reference is such a lattice.
    """
    mesh = outside(head.labels, head.spacing, head.origin - place)
    assert gap(mesh, reference_mesh, 95) < np.linalg.norm(head.spacing)


frames = st.fixed_dictionaries(
    {
        "direction": st.sampled_from(list(directions())),
        "oblique": st.one_of(st.just((0.0, 0.0, 0.0)), st.tuples(*[st.floats(-25, 25)] * 3)),
        "spacing": st.tuples(*[st.floats(0.6, 3.0)] * 3),
        "place": st.tuples(*[st.floats(-400, 400)] * 3),
        "shift": st.tuples(*[st.floats(0, 1)] * 3),
        "suffix": st.sampled_from(["nii.gz", "nrrd", "mha", "seg.nrrd"]),
    }
)


def expected(head, place):
    centres = head.origin + np.moveaxis(np.indices(head.labels.shape), 0, -1) * head.spacing - place
    return codes_at(centres)


def imported(folder, frame):
    turn = Rotation.from_rotvec(frame["oblique"], degrees=True).as_matrix()
    path = folder / f"head.{frame['suffix']}"
    spacing, place = np.array(frame["spacing"]), np.array(frame["place"])
    labels = write_head(path, frame["suffix"], turn @ frame["direction"], spacing, place, frame["shift"])
    return read_segmentation(path, "P1", labels, SEGMENTS), place


# Shrinking would take minutes and tell no more than the frame that failed.
COMMON = {
    "derandomize": True,
    "deadline": None,
    "phases": [Phase.generate],
    "suppress_health_check": [HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
}


def check_head(folder, frame, reference):
    head, place = imported(folder, frame)
    if not any(frame["oblique"]):
        # Nothing was resampled: each voxel is where it was.
        assert (head.labels != expected(head, place)).mean() < 1e-4
    check_surfaces(head, place, reference)


@settings(max_examples=8, **COMMON)
@given(frame=frames)
def test_a_frame_and_format_gives_the_same_head(tmp_path, reference, frame):
    check_head(tmp_path, frame, reference)


@pytest.mark.full
@settings(max_examples=50, **COMMON)
@given(frame=frames)
def test_any_frame_and_format_gives_the_same_head(tmp_path, reference, frame):
    check_head(tmp_path, frame, reference)


@settings(max_examples=4, **COMMON)
@given(frame=frames)
def test_any_frame_and_format_gives_the_same_mesh(tmp_path, reference_mesh, frame):
    head, place = imported(tmp_path, frame)
    check_mesh(head, place, reference_mesh)


UPRIGHT = np.eye(3), np.array([1.5, 1.2, 2.0]), np.array([-70.0, -210.0, 640.0])


def seg_nrrd(folder, segments, values=VALUES, layer=0):
    """A one-layer `.seg.nrrd` of the head whose header holds `segments`: (name, value, layer)."""
    direction, spacing, place = UPRIGHT
    points, origin = grid(direction, spacing, place)
    lookup = np.zeros(20, np.uint8)
    for name, code in CODES.items():
        lookup[code] = values[name]
    path = folder / "head.seg.nrrd"
    write_seg_nrrd(path, [lookup[codes_at(points)]], segments, direction, spacing, origin)
    return path


ALL = [(NAMES[name], VALUES[name], 0) for name in STRUCTURES]


@pytest.mark.parametrize("labels", [NAMES, VALUES, NAMES | {"cranium": VALUES["cranium"]}])
def test_slicer_segments_are_read_by_name_and_by_value(tmp_path, labels, caplog):
    path = seg_nrrd(tmp_path, [*ALL, ("Airway", 99, 0)])
    head = read_segmentation(path, "P1", labels, SEGMENTS)
    np.testing.assert_array_equal(head.labels, expected(head, UPRIGHT[2]))
    assert "segments 'Airway' (99) are not named" in caplog.text


def test_where_segments_are_named_a_value_by_default_takes_none(tmp_path):
    """The value of what the labels do not name stands for another segment in the file."""
    segments = [("Upper teeth" if name == "Mandible" else name, *rest) for name, *rest in ALL]
    path, labels = seg_nrrd(tmp_path, segments), NAMES | {"mandible": VALUES["mandible"]}
    assert read_segmentation(path, "P1", labels, SEGMENTS).segments == ("lefort1",)
    with pytest.raises(InputError, match="voxels of 'Upper teeth' .*because nothing in 'labels' names them"):
        read_segmentation(path, "P1", labels, SEGMENTS, unnamed_percent=5)


def test_overlapping_layers_keep_bone_over_muscle_over_skin_and_segments_over_the_cranium(tmp_path):
    """Nested boxes in three layers; the header lists the innermost first."""
    layers, wanted = np.zeros((3, 60, 60, 60), np.uint8), np.zeros((60, 60, 60), np.uint8)
    for number, name in enumerate(STRUCTURES):
        box = (slice(4 + 5 * number, 56 - 5 * number),) * 3
        layers[number % 3][box], wanted[box] = VALUES[name], CODES[name]
    segments = [(NAMES[name], VALUES[name], number % 3) for number, name in enumerate(STRUCTURES)]
    path = tmp_path / "boxes.seg.nrrd"
    write_seg_nrrd(path, layers, segments[::-1], np.eye(3), np.ones(3) * 2, np.zeros(3))
    np.testing.assert_array_equal(read_segmentation(path, "P1", NAMES, SEGMENTS).labels, wanted)


BAD_SEGMENTS = {
    "unknown name": (
        ALL, NAMES | {"cranium": "Upper skull"},
        r"no segment is called 'Upper skull' \('cranium'\); it holds 'Fat.*' \(3\), .*'Mandible' \(23\)", "labels",
    ),
    "unknown value": (ALL, VALUES | {"cranium": 77}, r"no segment has the number 77 .*'Mandible' \(23\)", "'labels'"),
    "two of a name": ([*ALL, ("Mandible", 99, 0)], NAMES, "2 segments are called 'Mandible'", "a name of its own"),
    "two of a value": ([*ALL, ("Chin", 23, 0)], VALUES, r"2 segments are called 23 \('Mandible' \(23\), 'C", "name"),
    "a layer below the first": ([*ALL, ("Chin", 99, -1)], NAMES, "lies in layer -1", "Slicer"),
    "a number in words": ([*ALL, ("Chin", "two", 0)], NAMES, "'Chin' has no whole number", "again"),
    "a layer in words": ([*ALL, ("Chin", 99, "x")], NAMES, "'Chin' has no whole number", "again"),
    "no such layer": ([*ALL, ("Chin", 99, 2)], NAMES, "lies in layer 2, the file has 1", "Slicer"),
    "empty": ([(n, 99 if n == "Mandible" else v, i) for n, v, i in ALL], NAMES, "'Mandible' .99.. is empty", "label"),
}  # fmt: skip


@pytest.mark.parametrize("fault", BAD_SEGMENTS)
def test_a_bad_segment_is_refused_with_the_names_that_exist(tmp_path, fault):
    segments, labels, problem, remedy = BAD_SEGMENTS[fault]
    path = seg_nrrd(tmp_path, segments)
    with pytest.raises(InputError, match=rf"case 'P1': .*head\.seg\.nrrd: .*{problem}.*Remedy: .*{remedy}"):
        read_segmentation(path, "P1", labels, SEGMENTS)


def test_slicer_files_before_4_11_hold_one_layer_per_segment(tmp_path):
    direction, spacing, place = UPRIGHT
    points, origin = grid(direction, spacing, place)
    path = tmp_path / "head.seg.nrrd"
    layers = np.stack(list(solids(points).values())).astype(np.uint8)
    write_seg_nrrd(path, layers, [(NAMES[name], 1, 0) for name in STRUCTURES], direction, spacing, origin)
    head, body = path.read_bytes().split(b"\n\n", 1)
    kept = [line for line in head.split(b"\n") if b"LabelValue" not in line and b"Layer" not in line]
    path.write_bytes(b"\n".join(kept) + b"\n\n" + body)
    segmentation = read_segmentation(path, "P1", NAMES, SEGMENTS)
    np.testing.assert_array_equal(segmentation.labels, expected(segmentation, UPRIGHT[2]))


def write_dicom_seg(path, direction, spacing, place, names=NAMES, fractional=False):
    """The solids of a head as overlapping segments of a DICOM-SEG."""
    points, origin = grid(direction, spacing, place)
    masks = np.stack([inside.T for inside in solids(points).values()], axis=-1)
    save_dicom_seg(path, masks, [names[name] for name in STRUCTURES], direction, spacing, origin, fractional)


NUMBERS = {name: number for number, name in enumerate(STRUCTURES, start=1)}
TILTED = Rotation.from_rotvec([12, 0, 0], degrees=True).as_matrix()


@pytest.mark.parametrize(
    ("direction", "labels", "fractional"),
    [(np.eye(3), NAMES, False), (TILTED, NUMBERS, False), (np.diag([-1.0, -1.0, 1.0]), NAMES, True)],
    ids=["names", "tilted, numbers", "prone, fractional"],
)
def test_dicom_seg_comes_in_with_its_names_and_numbers(tmp_path, reference, direction, labels, fractional):
    _, spacing, place = UPRIGHT
    write_dicom_seg(tmp_path / "head.dcm", direction, spacing, place, fractional=fractional)
    segmentation = read_segmentation(tmp_path / "head.dcm", "P1", labels, SEGMENTS)
    if direction is not TILTED:
        np.testing.assert_array_equal(segmentation.labels, expected(segmentation, UPRIGHT[2]))
        assert (segmentation.labels > 0).sum() == (codes_at(grid(direction, spacing, place)[0]) > 0).sum()
    # Not the skin: DICOM-SEG leaves empty slices out, so that the highest and lowest voxels of this head are a cut.
    head = surfaces(segmentation.labels, segmentation.spacing, segmentation.origin - place)
    for name in ("cranium", *SEGMENTS):
        assert gap(head[name], reference[name]) < np.linalg.norm(spacing)


def closed(inside, points, place):
    """Closed triangle surface of voxels of 1 mm, at `place`."""
    surface = contour(inside, np.ones(3), points[0, 0, 0] + place, 2.0)
    return pv.PolyData.from_regular_faces(*surface)


@pytest.fixture(scope="module")
def solid_surfaces():
    points, _ = grid(np.eye(3), np.ones(3), np.zeros(3))
    return {name: closed(inside, points, UPRIGHT[2]) for name, inside in solids(points).items()}


@pytest.fixture
def surface_folder(tmp_path, solid_surfaces):
    folder = tmp_path / "head"
    folder.mkdir()
    for (name, surface), suffix in zip(solid_surfaces.items(), ("stl", "ply", "obj", "vtp", "stl"), strict=True):
        surface.save(folder / f"{name}.{suffix}")
    (folder / "notes.txt").write_text("x")
    return folder


def test_a_folder_of_closed_surfaces_comes_in(surface_folder, reference, reference_mesh):
    head = read_segmentation(surface_folder, "P1", VALUES, SEGMENTS)
    np.testing.assert_array_equal(head.spacing, 1.0)
    check_surfaces(head, UPRIGHT[2], reference)
    check_mesh(head, UPRIGHT[2], reference_mesh)


def test_surfaces_are_read_by_the_names_of_their_files_and_in_ras(surface_folder, reference, caplog):
    (surface_folder / "mandible.stl").rename(surface_folder / "Lower jaw.stl")
    shown = pv.read(surface_folder / "muscle.ply")
    shown.save(surface_folder / "sketch.ply")
    scaled(surface_folder, [-1, -1, 1])
    head = read_segmentation(surface_folder, "P1", VALUES | {"mandible": "Lower jaw"}, SEGMENTS, "RAS")
    check_surfaces(head, UPRIGHT[2], reference)
    assert "segments 'sketch' are not named" in caplog.text


def test_a_surface_that_slicer_marks_as_ras_is_turned(surface_folder):
    before = read_segmentation(surface_folder, "P1", VALUES, SEGMENTS)
    for file in (surface_folder / "mandible.stl", surface_folder / "superficial.stl"):
        mesh = pv.read(file)
        mesh.points = mesh.points * [-1, -1, 1]
        mesh.save(file)
        content = file.read_bytes()
        file.write_bytes(b"3D Slicer output. SPACE=RAS".ljust(80) + content[80:])
    after = read_segmentation(surface_folder, "P1", VALUES, SEGMENTS)
    np.testing.assert_array_equal(after.labels, before.labels)


def test_bone_goes_over_muscle_over_skin_and_a_head_without_muscle_is_whole(surface_folder):
    (surface_folder / "muscle.ply").unlink()
    head = read_segmentation(surface_folder, "P1", VALUES, SEGMENTS)
    wanted = expected(head, UPRIGHT[2])
    wanted[wanted == CODES["muscle"]] = CODES["superficial"]
    assert (head.labels != wanted).sum() < 0.03 * (wanted > 0).sum()
    assert not (head.labels == CODES["muscle"]).any()


def test_overlapping_sheets_join_and_sheets_within_are_cavities():
    big, small = pv.Sphere(radius=20), pv.Sphere(radius=8, center=(4, 0, 0))
    overlapping = pv.Sphere(radius=10, center=(19, 0, 0))

    def volume(*parts):
        points, faces, count = [], [], 0
        for part in parts:
            points.append(np.asarray(part.points, float))
            faces.append(part.regular_faces + count)
            count += part.n_points
        grid, masks = voxelised([(np.concatenate(points), np.concatenate(faces))])
        return float(next(masks).sum())

    single = volume(big)
    assert single == pytest.approx(big.volume, rel=0.01)
    assert volume(big.flip_faces()) == single
    assert volume(big, small) == single
    assert volume(big, small.flip_faces()) == pytest.approx(big.volume - small.volume, rel=0.01)
    union = volume(big, overlapping)
    lens = np.pi * (20 + 10 - 19) ** 2 * (19**2 + 2 * 19 * (20 + 10) - 3 * (20 - 10) ** 2) / (12 * 19)
    assert union == pytest.approx(big.volume + overlapping.volume - lens, rel=0.01)


@pytest.mark.parametrize("cut", ["closed", "open", "torn"])
def test_a_flat_cut_of_the_skin_is_the_border_of_the_volume_and_a_round_end_is_not(surface_folder, cut):
    skin = pv.read(surface_folder / "superficial.stl")
    bottom = UPRIGHT[2][2] - 20.3
    clip = skin.clip_closed_surface if cut == "closed" else skin.clip
    skin = clip("z", origin=(0, 0, bottom), **({} if cut == "closed" else {"invert": False})).triangulate()
    if cut == "torn":  # a few triangles are lost
        skin = pv.PolyData.from_regular_faces(skin.points, np.delete(skin.regular_faces, [5, 6, 99, 1000], axis=0))
    skin.save(surface_folder / "superficial.stl")
    head = read_segmentation(surface_folder, "P1", VALUES, SEGMENTS)
    assert head.origin[2] - 0.5 == pytest.approx(bottom, abs=0.01)
    assert set(head.closed) == (set() if cut == "closed" else {"superficial"})
    for plane in head.closed.get("superficial", ()):
        assert plane["place"][2] == pytest.approx(bottom, abs=0.1) and abs(plane["normal"][2]) > 0.999
    ends = [(head.labels.take(end, axis) > 0).sum() for end in (0, -1) for axis in range(3)]
    assert ends[2] > 1000 and sum(ends) == ends[2]


def torn(folder):
    skin = pv.read(folder / "superficial.stl")
    pv.PolyData.from_regular_faces(skin.points, skin.regular_faces[::2]).save(folder / "superficial.stl")


def scaled(folder, factor):
    for file in folder.iterdir():
        if file.suffix != ".txt":
            mesh = pv.read(file)
            mesh.points = mesh.points * factor
            mesh.save(file)


def second(folder):
    pv.read(folder / "muscle.ply").save(folder / "muscle.stl")


BAD_FOLDER = {
    "torn": (torn, r"superficial\.stl: \d+ of its \d+ edges are open", "one surface"),
    "missing": (lambda d: (d / "cranium.obj").unlink(), "no segment is called 'cranium'.*'lefort1', ", "labels"),
    "no surface": (lambda d: [f.unlink() for f in d.iterdir()], "head: the folder holds no surface", "one surface"),
    "two files": (second, r"muscle\.stl: 'muscle' has two surfaces", "one file per structure"),
    "metres": (lambda d: scaled(d, 1e-3), "in metres", "millimetres"),
    "rubbish": (lambda d: (d / "lefort1.vtp").write_text("x"), r"lefort1\.vtp: ", "again|triangles"),
}  # fmt: skip


@pytest.mark.parametrize("fault", BAD_FOLDER)
def test_a_bad_folder_is_refused_by_case_file_and_remedy(surface_folder, fault):
    make, problem, remedy = BAD_FOLDER[fault]
    make(surface_folder)
    with pytest.raises(InputError, match=rf"case 'P1': .*{problem}.*Remedy: .*({remedy})"):
        read_segmentation(surface_folder, "P1", VALUES, SEGMENTS)


def test_the_cohort_table_takes_folders_of_surfaces_and_of_transforms_but_no_folder_as_scan(tmp_path):
    for folder in ("surfaces", "transforms"):
        (tmp_path / folder).mkdir()
    table = tmp_path / "cases.tsv"
    table.write_text("case\tsegmentation\tplan\tpostop\nP1\tsurfaces\ttransforms\t\n")
    assert read_cases(table)[0].plan == str(tmp_path / "transforms")
    table.write_text("case\tsegmentation\tplan\tpostop\nP1\tsurfaces\ttransforms\tsurfaces\n")
    with pytest.raises(InputError, match="the postop file does not exist"):
        read_cases(table)
