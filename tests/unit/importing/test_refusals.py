"""What users bring in wrong: each is refused at import, by the name of case and file, with a remedy."""

import json
from functools import cache
from types import SimpleNamespace

import numpy as np
import pytest
import pyvista as pv
import SimpleITK as sitk

from pinnochio.errors import InputError
from pinnochio.geometry.triangles import enclosed_volume
from pinnochio.model.surfaces import bone_surface, skin_surface, write_surface
from scripts.patient.import_plan import import_plan
from scripts.patient.register_postop import register_postop
from studies.planner.scan import read_scan
from tests.helpers import tools
from tests.helpers.coarse_head import IMPORTED, import_head
from tests.helpers.virtual_heads import virtual_head

SEGMENTS = ("lefort1", "mandible")
CUT = (*SEGMENTS, "proximal_left")
CODES = {"superficial": 1, "muscle": 2, "cranium": 10, "lefort1": 11, "mandible": 12}
PLAIN = ".nii.gz"


def head():
    """Nested blocks, 3 mm voxels: skin, muscle, three bones."""
    labels = np.zeros((40, 40, 40), np.uint8)
    labels[4:36, 4:36, 4:36] = 1
    labels[7:33, 7:33, 7:33] = 2
    for code, low in ((10, 28), (11, 20), (12, 10)):
        labels[10:30, 10:30, low : low + 5] = code
    return labels


def changed(*box, code, clear=None):
    """The head with a box of voxels set to `code`; `clear`: a code that becomes superficial first."""
    labels = head()
    if clear is not None:
        labels[labels == clear] = 1
    if box:
        labels[box] = code
    return labels


def write_image(path, labels, spacing=3.0):
    return tools.write(path, labels, None, spacing=(spacing,) * 3, origin=np.zeros(3))


def motion(**parts):
    return {"rotation": np.eye(3).tolist(), "translation": [0, -5, 0], "pivot": [0, 0, 0]} | parts


def plan_text(segment="lefort1", case="P1", head=None, **parts):
    return json.dumps({"case": case} | (head or {}) | {"segments": {"mandible": motion(), segment: motion(**parts)}})


def run_import(
    folder, segmentation=None, plan=None, values=CODES, segments=SEGMENTS, unlabelled="derived", limit=2.0, **more
):
    """Import a case into folder/out; segmentation and plan are paths, by default good ones."""
    if segmentation is None:
        segmentation = write_image(folder / f"P1{PLAIN}", head())
    made = folder / ("out" if plan is None else "imported")  # what is refused leaves nothing in `out`
    outputs = {name: str(made / file) for name, file in IMPORTED.items()}
    import_head("P1", str(segmentation), values, segments, "header", limit, unlabelled, outputs=outputs, **more)
    if plan is None:
        plan = folder / "P1.json"
        plan.write_text(plan_text())
    import_plan("P1", str(plan), outputs["bone"], str(folder / "out/plan.json"))


def of_labels(labels, spacing=3.0, suffix=PLAIN, **settings):
    """Imports the map `labels`."""
    return lambda folder: run_import(folder, write_image(folder / f"P1{suffix}", labels, spacing), **settings)


def colours(folder):
    plain = sitk.GetImageFromArray(head().transpose(2, 1, 0))
    sitk.WriteImage(sitk.Compose(plain, plain), str(folder / "P1.mha"))
    return folder / "P1.mha"


def text_file(folder, name, text):
    (folder / name).write_text(text)
    return folder / name


def of_text(name, text):
    """Imports a segmentation file that holds text."""
    return lambda folder: run_import(folder, text_file(folder, name, text))


def of_plan(text):
    def act(folder):
        (folder / "P1.json").write_bytes(text if isinstance(text, bytes) else text.encode())
        run_import(folder, plan=folder / "P1.json")

    return act


def afloat():
    """The head with its mandible in front of it."""
    labels = np.pad(changed(code=0, clear=12), ((0, 0), (20, 0), (0, 0)))
    labels[10:30, 2:12, 10:15] = 12
    return labels


@cache
def patient(deformity):
    """Bone and skin of a coarse virtual patient whose brow is wavy, so that left and right differ."""
    made = virtual_head(deformity, 3.0)
    grid = made.spacing, made.origin
    points, faces = skin_surface(made.labels, *grid, 4.0)
    points[:, 1] += 4 * np.sin(points[:, 0] / 12)
    return made.segments, bone_surface(made.labels, *grid, made.segments, 8.0), (points, faces)


def run_register(folder, scan, limit=1.5, top=1e9):
    """Register the scan at path `scan` on the asymmetric patient, whose skin ends at height `top`."""
    segments, bone, (points, faces) = patient("asymmetry")
    faces = faces[(points[faces, 2] < top).all(axis=1)]
    used, faces = np.unique(faces, return_inverse=True)
    (folder / "preop").mkdir()
    bone.write(folder / "preop/bone.vtp")
    write_surface(points[used], faces.reshape(-1, 3), folder / "preop/skin.vtp")
    (folder / "out").mkdir()
    skin, bone = str(folder / "preop/skin.vtp"), str(folder / "preop/bone.vtp")
    register_postop("P1", str(scan), skin, bone, 20.0, limit, str(folder / "out/postop.h5"))


def of_scan(points, faces=None, suffix="ply", **settings):
    def act(folder):
        points_, faces_ = points() if callable(points) else (points, faces)
        write_surface(points_, faces_, folder / f"P1.{suffix}")
        run_register(folder, folder / f"P1.{suffix}", **settings)

    return act


def skin_of(deformity="asymmetry", mirrored=False):
    def make():
        points, faces = patient(deformity)[2]
        return (points * [-1, 1, 1], faces[:, ::-1]) if mirrored else (points, faces)

    return make


def noisy_scan():
    """The skin's points, these with the noise that no scanner is without, and its faces wound inward, to be mended."""
    points, faces = skin_of()()
    return points, points + np.random.default_rng(0).normal(scale=0.05, size=points.shape), faces[:, ::-1]


def flat():
    plane = pv.Plane(i_size=150, j_size=200, i_resolution=60, j_resolution=60, direction=(0, -1, 0)).triangulate()
    return np.asarray(plane.points, float), plane.regular_faces


def spiked():
    points, faces = skin_of()()
    points = points.copy()
    chosen = np.random.default_rng(0).choice(len(points), len(points) // 20, replace=False)
    points[chosen] += np.random.default_rng(1).normal(scale=60, size=(len(chosen), 3))
    return points, faces


noise = np.random.default_rng(0)
noisy = head()
noisy[tuple(noise.integers(11, 29, (3, 900)))] = 12

# What is wrong: what is done with it, the case and the file of the error, words of its message.
BAD = {
    # the segmentation file
    "no segmentation": (lambda f: run_import(f, f / "P1.nrrd"), "P1", "P1.nrrd", "does not exist"),
    "a picture": (of_text("P1.jpg", "JFIF"), "P1", "P1.jpg", "no image format known here"),
    "colours": (lambda f: run_import(f, colours(f)), "P1", "P1.mha", "2 channel"),
    "rubbish": (of_text("P1.mha", "not an image"), "P1", "P1.mha", "no MetaImage"),
    "one slice": (of_labels(head()[:, :, 12:13]), "P1", "P1.nii.gz", "not a volume"),
    "NaN voxels": (of_labels(np.where(head() == 0, np.nan, head())), "P1", "P1.nii.gz", "NaN or infinite"),
    "the scan itself": (of_labels(head() * 0.37), "P1", "P1.nii.gz", "not whole numbers"),
    "voxels of 6 mm": (of_labels(head(), 6.0), "P1", "P1.nii.gz", "its voxels measure 6 mm"),
    "a mandible in the air": (of_labels(afloat()), "P1", "P1.nii.gz", "100 % of what surrounds 'mandible' is air"),
    "all air": (of_labels(0 * head()), "P1", "P1.nii.gz", "every voxel is 0"),
    "metres": (of_labels(head(), 0.003, ".mha"), "P1", "P1.mha", "0.096 mm.*metres"),
    "micrometres": (of_labels(head(), 3000.0), "P1", "P1.nii.gz", "9.6e[+]04 mm.*micrometres"),
    "no cranium": (of_labels(changed(code=0, clear=10)), "P1", "P1.nii.gz", "bone 'cranium' .* 10. is empty"),
    "no segment": (of_labels(np.where(head() > 10, 10, head())), "P1", "P1.nii.gz", "holds no bone segment"),
    "a jaw and its pieces": (of_labels(changed(np.s_[20:30], np.s_[10:30], np.s_[10:15], code=13), segments=CUT,
                                       values=CODES | {"proximal_left": 13}), "P1", "P1.nii.gz",
                             "'mandible' is the whole bone, and its pieces proximal_left are labelled too"),
    "no skin": (of_labels(np.where(head() == 1, 0, head())), "P1", "P1.nii.gz", "tissue 'superficial' .* is empty"),
    "unnamed segment": (of_labels(head(), segments=(*SEGMENTS, "chin")), "P1", "P1.nii.gz", "no voxel value.* 'chin'"),
    "name without names": (of_labels(head(), values=CODES | {"mandible": "Jaw"}), "P1", "P1.nii.gz", "'Jaw'.*no names"),
    # what the labels show
    "no muscle where it is wanted": (of_labels(changed(code=0, clear=2), unlabelled="refuse"), "P1", "P1.nii.gz",
                                     "no muscle is labelled"),
    "jaw in two halves": (of_labels(changed(np.s_[18:22], np.s_[10:30], np.s_[10:15], code=2)), "P1", "P1.nii.gz",
                          "'mandible' is in pieces of 800 and 800 voxels.*mandible_left"),
    "fragments": (of_labels(changed(np.s_[8:14], np.s_[8:14], np.s_[26:28], code=11)), "P1", "P1.nii.gz",
                  "3.47 % of 'lefort1' .72 of 2072 voxels; the limit is 2 %."),
    "salt and pepper": (of_labels(noisy), "P1", "P1.nii.gz", "stray voxels.* of 'mandible'"),
    "two faces": (of_labels(changed(np.s_[:], np.s_[:], np.s_[16:18], code=0)), "P1", "P1.nii.gz",
                  "'soft tissue' is in pieces.*one body"),
    "a segment of a few voxels": (of_labels(changed(np.s_[20:22], np.s_[20:22], np.s_[12:15], code=12, clear=12)), "P1",
                                  "P1.nii.gz", "100 % of 'mandible'"),
    "a repair limit that is no number": (of_labels(head(), limit=np.nan), "P1", "P1.nii.gz", "the limit is nan %"),
    # the plan; more of it in tests/helpers/corpus.py
    "plan in RAS": (of_plan(plan_text(head={"frame": "RAS"})), "P1", "P1.json", "frame is 'RAS'"),
    "plan of another case": (of_plan(plan_text(case="P2")), "P1", "P1.json", "belongs to case 'P2'"),
    "plan for no such segment": (of_plan(plan_text("chin")), "P1", "P1.json", "'chin', .* segmentation does not hold"),
    "plan without a segment": (of_plan(json.dumps({"segments": {"lefort1": motion()}})), "P1", "P1.json",
                               "says nothing of 'mandible'"),
    "far pivot": (of_plan(plan_text(rotation=[[0, -1, 0], [1, 0, 0], [0, 0, 1]], pivot=[0, 900, 0])), "P1", "P1.json",
                  "carries a point of 'lefort1'"),
    # the post-operative scan
    "point cloud": (lambda f: run_register(f, text_file(f, "P1.xyz", "0 0 0\n")), "P1", "P1.xyz",
                    "no surface format known here"),
    "another patient's scan": (of_scan(skin_of("class_ii"), limit=0.3), "P1", "P1.ply",
                               r"of \d\.\d\d mm .limit 0.3 mm"),
    "mirrored scan": (of_scan(skin_of(mirrored=True)), "P1", "P1.ply", r"residual of \d\.\d\d mm .*mirrored"),
    "the skin before surgery": (of_scan(skin_of()), "P1", "P1.ply", "it is this skin itself"),
    "a flat plane": (of_scan(flat, limit=5.0), "P1", "P1.ply", "flat|residual"),
    "a scan full of spikes": (of_scan(spiked), "P1", "P1.ply", "stand off from all around"),
    "a residual limit that is no number": (of_scan(skin_of(), limit=np.nan), "P1", "P1.ply", "limit nan mm"),
    "head without a forehead": (of_scan(skin_of(), top=-10.0), "P1", "P1.ply", "up to the forehead"),
}  # fmt: skip


@pytest.mark.parametrize("wrong", BAD)
def test_bad_input_is_refused_by_name(wrong, tmp_path):
    act, case, file, words = BAD[wrong]
    with pytest.raises(InputError, match=words) as caught:
        act(tmp_path)
    error = caught.value
    assert error.case == case and error.file.endswith(file) and f"'{case}'" in str(error) and file in str(error)
    assert len(error.remedy) > 10 and str(error).endswith(f"Remedy: {error.remedy}.")
    assert not list((tmp_path / "out").glob("*")), "a refused case leaves no file"


def test_the_same_without_the_fault_goes_in(tmp_path):
    run_import(tmp_path, volume="ct.nii.gz", markups=["lm.mrk.json"])
    said = json.loads((tmp_path / "out/report.json").read_text())
    assert said["muscle"] == "labelled" and said["repairs"] == []
    assert said["warnings"] == ["not used, because 'labels' names what is cut already: ct.nii.gz, lm.mrk.json"]
    (tmp_path / "unlabelled").mkdir()
    of_labels(changed(code=0, clear=2), unlabelled="single")(tmp_path / "unlabelled")
    assert json.loads((tmp_path / "unlabelled/out/report.json").read_text())["muscle"] == "single"
    (tmp_path / "scan").mkdir()
    of_scan(*noisy_scan()[1:], limit=0.05)(tmp_path / "scan")
    assert (tmp_path / "scan/out/postop.h5").exists()


def test_the_planner_reads_a_scan_as_the_study_does(tmp_path, from_in_place):
    points, scanned, inward = noisy_scan()
    of_scan(scanned, inward)(tmp_path)
    (tmp_path / "P1.ply").rename(tmp_path / "Postop.PLY")
    files = {name: str(tmp_path / f"preop/{name}.vtp") for name in ("skin", "bone")}
    settings = {"nasion_above_maxilla": 20.0, "limit": 1.5}
    prepared = SimpleNamespace(case="P1", home=str(tmp_path), scan=settings, **files)
    read, turned = read_scan(prepared)
    assert enclosed_volume(read - read.mean(axis=0), turned) > 0
    assert np.abs(read.min(axis=0) - points.min(axis=0)).max() < 1
    write_surface(1.05 * scanned, inward[:, ::-1], tmp_path / "P1.ply")
    (tmp_path / "P1.ply").rename(tmp_path / "Postop.PLY")
    with pytest.raises(InputError, match="'P1': .*Postop.PLY: (made 0.95. times|registered on the upper face)"):
        read_scan(prepared)
