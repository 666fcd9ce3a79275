"""Segmentation by thresholds of a made head: ellipsoid of tissue, hollow skull, jaws whose teeth touch, head holder."""

import json
from dataclasses import replace

import numpy as np
import pytest
import SimpleITK as sitk
from scipy import ndimage
from segment_ct import parser, segment_file

from pinnochio.errors import InputError
from pinnochio.importing.segmentation import read_labels
from pinnochio.importing.thresholding import Cuts, Plane, Thresholds, read_ct, segment_ct
from pinnochio.model.labels import AIR, CRANIUM, SUPERFICIAL, segment_code

SPACING, SHAPE = np.array([2.0, 2.0, 1.25]), (70, 80, 112)
THRESHOLDS = Thresholds(skin=500, bone=1500, opening=4.5, depth=50, aperture=10, margin=5)
CUTS = {
    "occlusal": {"point": [70, 50, 62], "normal": [0, 0, 1]},
    "lefort": {"point": [70, 50, 72], "normal": [0, 0, 2]},
    "pterygoid": {"point": [70, 82, 70], "normal": [0, 1, 0]},
    "joint": {"point": [70, 95, 82], "normal": [0, 0, 1]},
    "split": {"point": [70, 90, 60], "normal": [0, 1, 0]},
}


def box(at, low, high):
    return ((at >= low) & (at < high)).all(axis=-1)


def structures(at) -> dict[str, np.ndarray]:
    """Masks of what is at the places (..., 3) mm, LPS."""
    brain, foramen = box(at, (32, 43, 92), (108, 102, 104)), box(at, (62, 75, 80), (78, 91, 92))
    body = box(at, (45, 30, 42), (95, 75, 62)) & ~box(at, (55, 40, 42), (85, 75, 62))
    body |= box(at, (24, 65, 42), (45, 90, 55)) | box(at, (95, 65, 42), (116, 90, 55))
    rami = box(at, (24, 85, 42), (36, 105, 79.5)) | box(at, (104, 85, 42), (116, 105, 79.5))
    joints = box(at, (24, 85, 78), (36, 105, 81)) | box(at, (104, 85, 78), (116, 105, 81))
    skull = box(at, (24, 35, 81), (116, 110, 112)) & ~brain & ~foramen
    return {
        "head": (((at - (70, 75, 70)) / (62, 70, 66)) ** 2).sum(axis=-1) < 1,
        "skull": skull,
        "suture": box(at, (24, 77, 81), (116, 80, 112)) & skull,
        "hole": box(at, (60, 35, 95), (64, 43, 99)),
        "maxilla": box(at, (45, 30, 62), (95, 75, 81)) & ~box(at, (55, 40, 62), (85, 75, 76)),
        "mandible": body | rami,
        "joints": joints,
        "brain": brain,
        "holder": box(at, (20, 145, 20), (120, 149, 120)),
        "tube": box(at, (68, 0, 50), (72, 8, 54)),
        "hyoid": box(at, (60, 85, 30), (80, 95, 36)),
    }


def places(spacing, shape):
    return np.stack(np.indices(shape), axis=-1) * spacing


def scanned(at) -> np.ndarray:
    """Density at places (..., 3) mm: air 0, tissue 1000, bone 2000, joints 1700, a suture less; teeth touch."""
    part = structures(at)
    density = 1000.0 * (part["head"] | part["holder"] | part["tube"])
    for name in ("skull", "maxilla", "mandible", "hyoid"):
        density[part[name]] = 2000
    density[part["joints"]] = 1700
    density[part["suture"]] = 1620
    density[part["hole"]] = 1000
    return density


@pytest.fixture(scope="module")
def ct() -> sitk.Image:
    """The head with partial volumes and noise."""
    quarters = [SPACING * np.array(step) / 4 for step in ((-1, -1, -1), (-1, 1, 1), (1, -1, 1), (1, 1, -1))]
    density = np.mean([scanned(places(SPACING, SHAPE) + quarter) for quarter in quarters], axis=0)
    density += np.random.default_rng(7).normal(0, 60, SHAPE)
    image = sitk.GetImageFromArray(density.transpose(2, 1, 0).astype(np.float32))
    image.SetSpacing(SPACING.tolist())
    image.SetOrigin([-5.0, 10.0, 20.0])
    return image


@pytest.fixture(scope="module")
def cuts(tmp_path_factory) -> str:
    """The cuts as a file, moved with the origin of the CT."""
    moved = {
        name: {"point": np.add(cut["point"], [-5, 10, 20]).tolist(), "normal": cut["normal"]}
        for name, cut in CUTS.items()
    }
    path = tmp_path_factory.mktemp("cuts") / "cuts.json"
    path.write_text(json.dumps(moved))
    return str(path)


@pytest.fixture(scope="module")
def segmented(ct, cuts):
    return segment_ct(ct, Cuts.read(cuts), THRESHOLDS)


@pytest.fixture(scope="module")
def truth(segmented):
    return structures(places(segmented.spacing, segmented.labels.shape))


def astray(labelled, true) -> float:
    """Share of the true voxels wrong by more than a voxel: labelled outside their rim, or lost in their core."""
    outside = labelled & ~ndimage.binary_dilation(true, np.ones((3, 3, 3)))
    lost = ndimage.binary_erosion(true, np.ones((3, 3, 3))) & ~labelled
    return (outside | lost).sum() / true.sum()


def test_bones_are_parted_where_they_are(segmented, truth):
    labels, at = segmented.labels, places(segmented.spacing, segmented.labels.shape)
    lefort, behind = truth["maxilla"] & (at[..., 2] < 72), truth["mandible"] & (at[..., 1] > 90)
    expected = {
        CRANIUM: truth["skull"] | truth["hole"] | (truth["maxilla"] & ~lefort),
        segment_code(0): lefort,
        segment_code(1): truth["mandible"] & ~behind,
        # LPS: the patient's left is +x.
        segment_code(2): behind & (at[..., 0] > 70),
        segment_code(3): behind & (at[..., 0] < 70),
    }
    assert {code: astray(labels == code, true) for code, true in expected.items()} == pytest.approx(
        dict.fromkeys(expected, 0), abs=0.005
    )
    # The rami reach the joints, far above the occlusal plane, and nothing of the skull beyond them is theirs.
    mandible = labels > segment_code(0)
    top = at[mandible][:, 2].max()
    assert 78 <= top <= 81


def test_holes_of_thin_bone_are_closed_and_large_cavities_are_not(segmented, truth):
    assert (segmented.labels[truth["hole"]] == CRANIUM).mean() > 0.8
    assert (segmented.labels[truth["brain"]] == CRANIUM).mean() < 0.1


def test_brain_and_what_is_not_the_head_are_left_out(segmented, truth):
    assert not (segmented.labels[truth["brain"]] == SUPERFICIAL).any()
    # Only where they touch the head may a rim of them stay.
    assert (segmented.labels[truth["holder"]] != AIR).mean() < 0.08
    at = places(segmented.spacing, segmented.labels.shape)
    assert (segmented.labels[at[..., 1] < 3] == AIR).all()
    assert not np.isin(segmented.labels[truth["hyoid"]], [CRANIUM, segment_code(1)]).any()


def test_tissue_between_the_dental_arches_is_left_out(segmented):
    at = places(segmented.spacing, segmented.labels.shape)
    mouth = box(at, (57, 42, 53), (83, 74, 74))
    assert (segmented.labels[mouth] == SUPERFICIAL).mean() < 0.02


def test_the_box_cuts_the_map_and_changes_nothing_inside(ct, cuts, segmented):
    whole = Cuts.read(cuts)
    part = segment_ct(
        ct, replace(whole, low=np.array([-np.inf, 25, -np.inf]), high=np.array([np.inf, 140, 150])), THRESHOLDS
    )
    assert part.origin == pytest.approx([-5, 25, 20])
    assert np.array_equal(part.labels, segmented.labels[:, 10:87, :87])


def test_tissue_reaches_from_the_skin_to_its_depth(ct, cuts):
    thresholds = replace(THRESHOLDS, depth=20, closing=0.5)
    shallow = segment_ct(ct, Cuts.read(cuts), thresholds)
    part = structures(places(shallow.spacing, shallow.labels.shape))
    bones = np.any([part[name] for name in ("skull", "mandible", "maxilla", "joints")], axis=0)
    depth = 1.5 * ndimage.distance_transform_edt(part["head"])
    soft = shallow.labels == SUPERFICIAL
    assert soft[(depth > 1.5) & (depth < 10) & ~bones].mean() > 0.98
    assert 17 < depth[soft].max() < 23.5
    # Hardly closed, the hole in the skull stays.
    assert (shallow.labels[part["hole"]] == CRANIUM).mean() < 0.7


@pytest.mark.parametrize("axes", ["LPI", "RAS", "SPL"])
def test_a_wrong_header_is_corrected(ct, tmp_path, axes):
    """The volume stored along other axes under a header that says nothing comes back as it was."""
    turned = sitk.GetArrayFromImage(sitk.DICOMOrient(ct, axes))
    stored = sitk.GetImageFromArray(turned)
    stored.SetSpacing(sitk.DICOMOrient(ct, axes).GetSpacing())
    path = str(tmp_path / "ct.nrrd")
    sitk.WriteImage(stored, path)
    read = read_ct(path, axes)
    assert np.allclose(sitk.GetArrayFromImage(read), sitk.GetArrayFromImage(ct))
    assert np.allclose(read.GetDirection(), np.eye(3).ravel()) and np.allclose(read.GetSpacing(), SPACING)


def test_the_command_line_writes_the_same_map(ct, cuts, segmented, tmp_path):
    sitk.WriteImage(ct, str(tmp_path / "ct.nrrd"))
    arguments = f"--cuts {cuts} --skin 500 --bone 1500 --opening 4.5 --depth 50 --aperture 10 --margin 5".split()
    options = parser().parse_args(["ct.nrrd", "labels.nii.gz", *arguments])
    made = Thresholds(**{name: getattr(options, name) for name, *_ in Thresholds.options()})
    assert made == THRESHOLDS
    labels = str(tmp_path / "labels.nii.gz")
    volumes = segment_file(str(tmp_path / "ct.nrrd"), options.cuts, options.orientation, made, labels)
    written = read_labels(labels)
    assert np.array_equal(written.labels, segmented.labels) and np.allclose(written.origin, segmented.origin)
    assert volumes["cranium"] == pytest.approx((segmented.labels == CRANIUM).sum() * 1.5**3 / 1000)
    assert "muscle" not in volumes


def refused(call, word):
    with pytest.raises(InputError, match=word):
        call()


def test_bad_cuts_are_refused(tmp_path):
    path = tmp_path / "cuts.json"

    def read(change):
        path.write_text(json.dumps({key: value for key, value in (CUTS | change).items() if value is not None}))
        return lambda: Cuts.read(path)

    assert Cuts.read(path if read({})() else None).lefort.normal == pytest.approx([0, 0, 1])
    refused(read({"joint": None}), "joint")
    refused(read({"lefort": {"point": [0, 0, 0], "normal": [0, 0, 0]}}), "normal")
    refused(read({"lefort": {"point": [0, 0], "normal": [0, 0, 1]}}), "three numbers")
    refused(read({"low": [0, 0]}), "three values")
    refused(read({"leforte": CUTS["lefort"]}), "leforte")
    refused(read({"leforte": None, "low": [0, 0, float("nan")]}), "not finite")
    for text in ("{", 100_000 * "["):
        path.write_text(text)
        refused(lambda: Cuts.read(path), "is not JSON|nested too deeply")
    refused(lambda: Cuts.read(tmp_path / "none.json"), "cannot be read")


def test_bad_thresholds_and_scans_are_refused(ct, cuts, tmp_path):
    refused(lambda: Thresholds(1500, 500), "not below")
    refused(lambda: Thresholds(500, 1500, spacing=0), "spacing")
    read = Cuts.read(cuts)
    refused(lambda: segment_ct(ct, read, Thresholds(500, 9000)), "no bone")
    refused(lambda: segment_ct(ct, read, Thresholds(8000, 9000)), "no bone")
    far = replace(read, low=np.full(3, 1e4))
    refused(lambda: segment_ct(ct, far, THRESHOLDS), "nothing of the scan")
    filled = sitk.Cast(ct, sitk.sitkFloat32) + 600
    refused(lambda: segment_ct(filled, read, Thresholds(500, 2100, opening=4.5)), "outer air")
    (tmp_path / "ct.nrrd").write_text("no image")
    refused(lambda: read_ct(tmp_path / "ct.nrrd"), "cannot be read")
    oblique = sitk.Image(ct)
    oblique.SetDirection([0.8, 0.6, 0, -0.6, 0.8, 0, 0, 0, 1])
    sitk.WriteImage(oblique, str(tmp_path / "oblique.nrrd"))
    refused(lambda: read_ct(tmp_path / "oblique.nrrd"), "oblique")


def test_height_over_a_plane():
    plane = Plane(np.array([0.0, 0, 2]), np.array([0.0, 0.6, 0.8]))
    assert plane.height(np.array([[5.0, 1, 2], [5, 0, 3]])) == pytest.approx([0.6, 0.8])
