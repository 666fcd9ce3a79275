"""From what free tools write to segments: presets, soft tissue from the scan, virtual osteotomy, several files."""

import json

import numpy as np
import pytest
import pyvista as pv
import SimpleITK as sitk
from PIL import Image

from pinnochio.errors import InputError
from pinnochio.importing.markups import read_markups
from pinnochio.importing.presets import PRESETS
from pinnochio.importing.segmentation import read_labels
from pinnochio.model.surfaces import BoneSurface
from pinnochio.plans.plan import Plan
from pinnochio.virtual.head import build_head
from pinnochio.virtual.scanned import sample_patient
from scripts.patient.import_plan import import_plan
from scripts.patient.show_segments import show_segments
from tests.helpers import tools
from tests.helpers.tools import SEGMENTS, run

SHOWN = ("bone.vtp", "skin.vtp", "report.json")
FOUR = ["lefort1", "mandible_distal", "proximal_left", "proximal_right"]


@pytest.fixture(scope="module")
def head():
    return build_head(sample_patient(np.random.default_rng(3), "class_iii"), 2.5)


@pytest.fixture(scope="module")
def scan(head, tmp_path_factory):
    return str(tools.write(tmp_path_factory.mktemp("scan") / "ct.nii.gz", tools.scan(head), head))


@pytest.fixture(scope="module")
def imported(head, scan, tmp_path_factory):
    """What a dental segmentation becomes: its folder, report and labels."""
    folder = tmp_path_factory.mktemp("imported")
    return folder, *run(folder, tools.write(folder / "P1.nii.gz", tools.dental(head), head), volume=scan)


def agreement(one, other) -> float:
    """Dice of two masks."""
    return 2 * (one & other).sum() / (one.sum() + other.sum())


def as_tool(preset, masks) -> np.ndarray:
    """The head as the one label map of a tool."""
    tissue = masks["tissue"]
    below = np.cumsum(masks["upper_teeth"].any(axis=(0, 1))[::-1])[::-1] == 0
    layers = {
        "dentalsegmentator": [("skull", 1), ("mandible", 2), ("upper_teeth", 3), ("lower_teeth", 4), ("canal", 5)],
        "nasomaxilla": [("skull", 1), ("mandible", 2), ("upper_teeth", 4), ("lower_teeth", 5), ("canal", 6)],
        "universal": [("skull", 54), ("mandible", 53), ("upper_teeth", 8), ("lower_teeth", 25), ("canal", 55)],
        "amasss": [("tissue", 6), ("skull", 2), ("upper_teeth", 4), ("mandible", 1), ("lower_teeth", 1)],
        "totalsegmentator": [("tissue", 4), ("skull", 3), ("mandible", 1), ("upper_teeth", 7), ("lower_teeth", 2)],
    }[preset]
    values = np.zeros(tissue.shape, np.uint8)
    for name, value in layers:
        values[masks[name]] = value
    if preset == "nasomaxilla":  # its skull without the maxilla, which has a value of its own
        low = np.arange(tissue.shape[2]) < np.argwhere(masks["upper_teeth"])[:, 2].max() + 4
        values[masks["skull"] & ~below & low] = 3
    if preset == "universal":  # each tooth has its own; here right and left of both jaws
        left = np.arange(tissue.shape[0])[:, None, None] > tissue.shape[0] / 2
        values[masks["upper_teeth"] & left], values[masks["lower_teeth"] & left] = 9, 24
    return values


@pytest.mark.parametrize("preset", PRESETS)
def test_each_preset_becomes_segments(head, scan, preset, tmp_path):
    masks = tools.structures(head)
    path = tools.write(tmp_path / "P1.nii.gz", as_tool(preset, masks), head)
    labelled = preset in ("amasss", "totalsegmentator")
    cuts = ("split",) if preset == "amasss" else ("lefort1", "split")  # its teeth are bone: no roots to see
    said, made = run(tmp_path, path, preset, None if labelled else scan, cuts)
    assert [name for name, volume in said["volume_cm3"].items() if volume][-3:] == FOUR[1:]
    assert said["tool"] == preset and ("Otsu" in said["soft_tissue"]) != labelled
    jaw = np.isin(made.labels, (11, 12, 13) if preset == "amasss" else (12, 13, 14))
    assert agreement(jaw, masks["mandible"] | masks["lower_teeth"]) > 0.95
    bone = made.labels >= 10
    assert agreement(bone, head.labels >= 10) > 0.95


def test_cuts_lie_where_surgeons_cut(head, imported):
    folder, said, made = imported
    for code, least in ((11, 0.8), (12, 0.8), (13, 0.8), (14, 0.8)):  # against the cuts of the virtual cohort
        assert agreement(made.labels == code, head.labels == code) > least, code
    assert said["landmarks"]["Me"]["source"] == "found on the bone" and "guess" in said["cuts"]["lefort1"]
    right, left = (np.array(said["landmarks"][name]["place"]) for name in ("RCo", "LCo"))
    assert left[0] > 35 and right[0] < -35 and left[2] > np.array(said["landmarks"]["LGo"]["place"])[2] + 30
    assert "nothing labelled tells left from right" in said["frame"]["sides"]
    assert list(BoneSurface.read(folder / "out/bone.vtp").segments) == FOUR


def test_soft_tissue_of_the_scan_is_the_face(head, imported):
    made = imported[2]
    soft = np.isin(made.labels, (1, 2))
    assert not (soft & (head.labels == 0))[:, :, 5:-5].sum() > 0.03 * soft.sum()
    near = np.isin(head.labels, (1, 2))
    assert (soft & near).sum() > 0.9 * near.sum()


def test_landmarks_and_planes_decide_and_are_said(head, scan, tmp_path):
    path = tools.write(tmp_path / "P1.nii.gz", tools.dental(head), head)
    said = run(tmp_path, path, volume=scan, cuts=("lefort1", "split", "chin"))[0]
    menton = np.array(said["landmarks"]["Me"]["place"])
    points = [tools.points(tmp_path / "a.mrk.json", frame="RAS", Me=menton + [0, 0, 4])]
    points += [tools.plane(tmp_path / "m.mrk.json", "Midline plane", [0, 0, 0], [1, 0, 0])]  # of SlicerOsteotomyCuts
    level = float(np.array(said["landmarks"]["ANS"]["place"])[2])
    for how in ("normal", "matrix"):
        cut = [tools.plane(tmp_path / "b.mrk.json", "lefort1", [0, -60, level], [0, 0.1, -1], how)]
        moved, made = run(tmp_path, path, volume=scan, cuts=("lefort1", "split", "chin"), markups=points + cut)
        assert moved["cuts"]["lefort1"] == "the plane that was given"
        top = np.argwhere(made.labels == 11)[:, 2].max() * made.spacing[2] + made.origin[2]
        assert top < level + 6
    assert moved["landmarks"]["Me"] == {"place": (menton + [0, 0, 4]).round(2).tolist(), "source": "given"}
    assert moved["volume_cm3"]["chin"] > said["volume_cm3"]["chin"] + 0.3
    unknown = [tools.plane(tmp_path / "c.mrk.json", "osteotomy", [0, 0, 0], [0, 0, 1])]
    with pytest.raises(InputError, match="plane 'osteotomy' is no cut known here.*split_left"):
        run(tmp_path, path, volume=scan, markups=unknown)


@pytest.mark.parametrize("how", ["normal", "matrix", "slicer", "points"])
def test_a_plane_comes_in_by_the_name_of_its_file(tmp_path, how):
    """Beside lines of cuts, whose points all bear one label."""
    for number in range(2):
        curve = tools.points(tmp_path / f"line{number}.mrk.json", **{"Osteotomy line-1": np.ones(3)})
        curve.write_text(curve.read_text().replace("Fiducial", "Curve"))
    tools.plane(tmp_path / "any.mrk.json", "lefort1", np.array([3, -60, -20]), [0, 0.1, -1], how)
    read = read_markups(sorted(tmp_path.iterdir()), "P1").planes
    assert list(read) == ["lefort1"] and abs(read["lefort1"].normal @ [0, 0.1, -1]) > 0.9999 * np.hypot(1, 0.1)
    np.testing.assert_allclose(read["lefort1"].point, [3, -60, -20])


def test_pieces_that_are_cut_already_go_before_the_rule(head, scan, imported, tmp_path):
    """Cut steeper than by rule, as segments beside the tool's, and as files of a folder."""
    masks = tools.structures(head)
    x, y, z = np.indices(head.labels.shape)
    steep, behind = z > np.argwhere(masks["skull"])[:, 2].min() + 8, y > np.argwhere(masks["mandible"])[:, 1].mean() - 4
    left = x > head.labels.shape[0] / 2
    made = {
        "lefort1": np.isin(head.labels, 11) & ~masks["upper_teeth"] & ~steep,
        "proximal_left": masks["mandible"] & behind & left,
        "proximal_right": masks["mandible"] & behind & ~left,
        "chin": masks["mandible"] & (z < np.argwhere(masks["mandible"])[:, 2].min() + 5) & ~behind,
    }
    names = ["Upper Skull", "Mandible", "Upper Teeth", "Lower Teeth", "Mandibular canal", *made]
    layers = [tools.dental(head) == value for value in range(1, 6)] + [*made.values()]
    path = tmp_path / "P1.seg.nrrd"
    segments = [(name, 1, number) for number, name in enumerate(names)]
    tools.write_seg_nrrd(path, layers, segments, np.eye(3), head.spacing, head.origin)
    (tmp_path / "segmentation").mkdir()
    tools.write(tmp_path / "segmentation/P1.nii.gz", tools.dental(head), head)
    for name, mask in made.items():
        tools.write(tmp_path / f"segmentation/{name}.nii.gz", mask.astype(np.uint8), head)
    (tmp_path / "surfaces").mkdir()
    tools.write(tmp_path / "surfaces/P1.nii.gz", tools.dental(head), head)
    for name, mask in made.items():  # closed models, as of 3D Slicer's osteotomy modules
        outline(mask, head, tmp_path / f"surfaces/{name}.stl")
    for source in (path, tmp_path / "segmentation", tmp_path / "surfaces"):
        said, cut = run(tmp_path, source, volume=scan, accept=True)
        assert set(said["cuts"].values()) == {"the piece that the segmentation holds"} and len(said["cuts"]) == 4
        for code, name in ((11, "lefort1"), (13, "proximal_left"), (14, "proximal_right"), (15, "chin")):
            expected = made[name] | (masks["upper_teeth"] if code == 11 else False)
            assert agreement(cut.labels == code, expected) > (0.9 if source.name == "surfaces" else 0.97), name
        assert agreement(cut.labels == 11, imported[2].labels == 11) < 0.95


def outline(mask, head, path, front=None):
    """Save a mask's contour, open where the volume ends; of a front alone, what lies before a wavy line."""
    grid = pv.ImageData(dimensions=mask.shape, spacing=head.spacing, origin=head.origin)
    surface = grid.contour([0.5], scalars=mask.astype(float).ravel(order="F"))
    if front is not None:
        x, y, z = surface.cell_centers().points.T
        surface = surface.extract_cells(y < front + 0.2 * np.abs(x) + 8 * np.sin(z / 10)).extract_surface(
            algorithm="dataset_surface"
        )
        surface = surface.connectivity("largest").triangulate()
    surface.save(path)


@pytest.mark.parametrize("front", [None, -20.0])
def test_surfaces_alone_become_a_case_whose_open_skin_is_closed(head, front, tmp_path):
    """Bones and a skin that ends with its scan; or a face alone, which ends anywhere."""
    folder, masks = tmp_path / "segmentation", tools.structures(head)
    folder.mkdir()
    for name, file in (("skull", "Skull.stl"), ("mandible", "mandible.ply"), ("upper_teeth", "upper teeth.vtp")):
        outline(masks[name], head, folder / file)
    outline(masks["tissue"], head, folder / "skin.stl", front)
    said, made = run(tmp_path, folder)
    assert [name for name, volume in said["volume_cm3"].items() if volume][-4:] == FOUR
    assert set(said["closed"]) == {"upper_skull", "skin"} and "skin.stl is open" in str(said["warnings"])
    places = np.argwhere(made.labels) * made.spacing + made.origin
    index = np.rint((places - head.origin) / head.spacing).astype(int).T
    inside = (index >= 0).all(axis=0) & (index < np.array(head.labels.shape)[:, None]).all(axis=0)
    ahead = places[inside, 1] < -40
    here, there = made.labels[made.labels > 0][inside][ahead], head.labels[tuple(index[:, inside])][ahead]
    assert inside.mean() > 0.98 and (there > 0).mean() > 0.97
    for soft in (True, False):
        assert agreement(np.isin(here, (1, 2)) == soft, np.isin(there, (1, 2)) == soft) > 0.9
    show_segments(*(str(tmp_path / "out" / name) for name in SHOWN), tmp_path / "a.png")
    red, green, blue = np.asarray(Image.open(tmp_path / "a.png").convert("RGB"), int).reshape(-1, 3).T
    assert ((red - blue > 30) & (red - green > 12)).mean() > 0.02  # the planes
    (folder / "upper teeth.vtp").unlink()
    for name, said in (
        ("bone.ply", "nothing says what the surface 'bone' is.*mandible.*part one of all bones first"),
        ("upper_teeth.ply", "no mandible is labelled.*part one of all bones first"),
        ("mandible.vtk", r"mandible\.vtk: such surfaces are not read.*\.stl"),
    ):
        next(folder.glob("*.ply")).rename(folder / name)
        with pytest.raises(InputError, match=said):
            run(tmp_path, folder)


def test_without_the_split_the_mandible_stays_whole(head, scan, tmp_path):
    path = tools.write(tmp_path / "P1.nii.gz", tools.dental(head), head)
    said = run(tmp_path, path, volume=scan, cuts=("lefort1",))[0]
    assert [name for name in said["volume_cm3"] if name in SEGMENTS] == ["lefort1", "mandible"]


def test_several_files_are_one_segmentation(head, tmp_path):
    masks = tools.structures(head)
    folder = tmp_path / "segmentation"
    folder.mkdir()
    values = as_tool("totalsegmentator", masks)
    tools.write(folder / "P1_craniofacial_structures.nii.gz", values, head)
    muscle = np.zeros(values.shape, np.uint8)
    left = np.arange(values.shape[0])[:, None, None] > values.shape[0] / 2
    muscle[masks["muscle"] & left], muscle[masks["muscle"] & ~left] = 2, 1
    tools.write(folder / "P1_head_muscles.nii.gz", muscle, head)
    said, made = run(tmp_path, folder, "totalsegmentator")
    assert said["muscle"] == "labelled" and said["frame"]["sides"] == "as it should be"
    assert agreement(made.labels == 2, masks["muscle"]) > 0.8

    single = tmp_path / "single"
    single.mkdir()
    names = {"skull": "skull", "mandible": "mandible", "upper_teeth": "teeth_upper", "lower_teeth": "teeth_lower"}
    for name, stem in (names | {"tissue": "head"}).items():
        tools.write(single / f"{stem}.nii.gz", masks[name].astype(np.uint8), head)
    tools.write(single / "masseter_left.nii.gz", (masks["muscle"] & left).astype(np.uint8), head)
    tools.write(single / "masseter_right.nii.gz", (masks["muscle"] & ~left).astype(np.uint8), head)
    apart = run(tmp_path, single, "totalsegmentator")[1]
    assert agreement(apart.labels == 2, made.labels == 2) > 0.99
    for code in (1, 10, 11, 12, 13, 14):
        assert agreement(apart.labels == code, made.labels == code) > 0.97, code

    tools.write(folder / "notes.nii.gz", muscle, head)
    with pytest.raises(InputError, match="nothing says what 'notes.nii.gz' is.*craniofacial_structures, head_muscles"):
        run(tmp_path, folder, "totalsegmentator")


def test_a_region_of_interest_crops(head, scan, tmp_path):
    path = tools.write(tmp_path / "P1.nii.gz", tools.dental(head), head)
    region = tmp_path / "roi.mrk.json"
    box = {"type": "ROI", "coordinateSystem": "LPS", "center": [0, -64, -40], "size": [300, 300, 130]}
    region.write_text(json.dumps({"markups": [box | {"orientation": [-1, 0, 0, 0, -1, 0, 0, 0, 1]}]}))
    made = run(tmp_path, path, volume=scan, markups=[region])[1]
    assert made.labels.shape[2] * made.spacing[2] == pytest.approx(130, abs=3)
    low, high = read_markups([region], "P1").regions[0]
    np.testing.assert_allclose(np.stack([low, high]), [[-150, -214, -105], [150, 86, 25]])


def test_matrices_of_areg_are_the_plan_that_was_carried_out(imported, tmp_path):
    """Each from the first scan to the second, whose frame is another: the head turned, the lower jaw 4 mm forward."""
    (tmp_path / "plan").mkdir()
    for region, forward in (("CB", 0), ("MAND", -4)):
        matrix = sitk.Euler3DTransform()
        matrix.SetRotation(0.1, 0.0, 0.3)
        matrix.SetTranslation(matrix.TransformPoint((30.0, forward - 20.0, 5.0)))
        sitk.WriteTransform(matrix, str(tmp_path / f"plan/P1_{region}Reg_matrix.tfm"))
    import_plan("P1", str(tmp_path / "plan"), str(imported[0] / "out/bone.vtp"), str(tmp_path / "plan.json"))
    plan = Plan.read(tmp_path / "plan.json", "P1")
    np.testing.assert_allclose(plan.motion("mandible_distal").apply(np.zeros((1, 3))), [[0, -4, 0]], atol=1e-6)
    assert not np.any(plan.motion("lefort1").displacement(np.ones((1, 3))))


def test_a_second_segmentation_is_the_plan_that_was_carried_out(imported, tmp_path):
    """The same head after surgery, in another frame, with all that the tool labels; motions of whole voxels."""
    bone, labels = (str(imported[0] / f"out/{name}") for name in ("bone.vtp", "labels.nii.gz"))
    before = read_labels(labels)
    upper, lower = before.labels == 11, before.labels == 12
    after = np.zeros(before.labels.shape, np.uint8)
    after[before.labels == 10] = 1
    after[(before.labels == 13) | (before.labels == 14)] = 2
    after[np.roll(upper, -2, axis=1)] = 1  # 5 mm forward
    after[np.roll(np.roll(lower, 2, axis=1), 1, axis=2)] = 2  # 5 mm back, 2.5 mm up
    turn = np.array([[np.cos(0.2), -np.sin(0.2), 0], [np.sin(0.2), np.cos(0.2), 0], [0, 0, 1]])
    path = tools.write(tmp_path / "post.gipl.gz", after, before, origin=before.origin + [12, -7, 30])
    turned = tools.write(tmp_path / "post.nrrd", after, before, direction=turn)
    out = str(tmp_path / "plan.json")
    for source in (path, turned):
        import_plan("P1", str(source), bone, out, labels, "dentalsegmentator", limit=0.8)
        plan = Plan.read(tmp_path / "plan.json", "P1")
        for name, wanted in (("lefort1", [0, -5, 0]), ("mandible_distal", [0, 5, 2.5]), ("proximal_left", [0, 0, 0])):
            motion = plan.motion(name)
            moved = motion.apply(motion.pivot[None])[0] - motion.pivot
            assert np.linalg.norm(moved - wanted) < 0.7, (name, moved)
    with pytest.raises(InputError, match="the tool does not write"):
        after[after == 1] = 44
        wrong = str(tools.write(tmp_path / "post.nii.gz", after, before))
        import_plan("P1", wrong, bone, out, labels, "dentalsegmentator")
