"""One head in the variants that clinics bring: each is imported as the head that it is, or refused. None is silent."""

import re

import numpy as np
import pytest
import SimpleITK as sitk
from scipy import ndimage

from pinnochio.errors import InputError
from pinnochio.importing import head_parts
from pinnochio.virtual.head import build_head
from pinnochio.virtual.scanned import sample_patient
from tests.helpers import tools
from tests.helpers.settings import ROOT
from tests.helpers.tools import run

SPACING = 3.0


@pytest.fixture(scope="module")
def head():
    return build_head(sample_patient(np.random.default_rng(3), "class_iii"), SPACING)


@pytest.fixture(scope="module")
def pair(head):
    """Label map and scan as images."""
    made = []
    for values in (tools.dental(head), tools.scan(head)):
        image = sitk.GetImageFromArray(np.ascontiguousarray(values.transpose(2, 1, 0)))
        image.SetSpacing(head.spacing.tolist())
        image.SetOrigin(head.origin.tolist())
        made.append(image)
    return made


@pytest.fixture(scope="module")
def reference(pair, tmp_path_factory):
    """Volume of the lower jaw (cm3), soft tissue (cm3) and the lowest of the chin."""
    return measured(pair, tmp_path_factory.mktemp("reference"))


def measured(pair, folder, **settings):
    for image, name in zip(pair, ("P1.nii.gz", "ct.nii.gz"), strict=True):
        if image is not None:
            sitk.WriteImage(image, str(folder / name))
    volume = str(folder / "ct.nii.gz") if pair[1] is not None else None
    said, _ = run(folder, folder / "P1.nii.gz", volume=volume, **settings)
    jaw = sum(said["volume_cm3"][name] for name in ("mandible_distal", "proximal_left", "proximal_right"))
    soft = said["volume_cm3"]["superficial"] + said["volume_cm3"]["muscle"]
    return jaw, soft, np.array(said["landmarks"]["Me"]["place"]), said


def header(pair, spacing=None, direction=None):
    """The same voxels under another header."""
    made = []
    for image in pair:
        image = sitk.Image(image)
        if spacing is not None:
            image.SetSpacing(spacing)
        if direction is not None:
            image.SetDirection(np.ravel(np.asarray(direction, float)).tolist())
        made.append(image)
    return made


def turned(axis, angle):
    return np.array(sitk.VersorTransform(list(axis), np.radians(angle)).GetMatrix()).reshape(3, 3)


def regridded(pair, spacing=(SPACING,) * 3, direction=None):
    """The head where it was, on another grid."""
    direction = np.eye(3) if direction is None else direction
    made = []
    for image, method, outside in zip(pair, (sitk.sitkNearestNeighbor, sitk.sitkLinear), (0, -1000), strict=True):
        extent = (np.array(image.GetSize()) - 1) * image.GetSpacing()
        middle = np.array(image.GetOrigin()) + extent / 2
        size = np.ceil((extent + 40 * (not np.allclose(direction, np.eye(3)))) / spacing).astype(int) + 1
        start = middle - direction @ ((size - 1) * spacing / 2)
        made.append(
            sitk.Resample(image, size.tolist(), sitk.Transform(), method, start.tolist(), list(spacing),
                          np.ravel(direction).tolist(), outside)
        )  # fmt: skip
    return made


def changed(pair, labels=None, scan=None):
    """Other values: functions of the arrays [iz, iy, ix]."""
    made = []
    for image, change in zip(pair, (labels, scan), strict=True):
        values = sitk.GetArrayFromImage(image)
        if change is not None:
            values = change(values.copy())
        other = sitk.GetImageFromArray(values)
        other.CopyInformation(image)
        made.append(other)
    return made


def cropped(pair, **sides):
    """Without so many mm at an end: brow, chin, back."""
    size = np.array(pair[0].GetSize())
    low, high = np.zeros(3, int), size.copy()
    low[2] += round(sides.get("chin", 0) / SPACING)
    high[2] -= round(sides.get("brow", 0) / SPACING)
    high[1] -= round(sides.get("back", 0) / SPACING)
    return [image[low[0] : int(high[0]), low[1] : int(high[1]), int(low[2]) : int(high[2])] for image in pair]


def replaced(old, new):
    return lambda values: np.where(values == old, np.uint8(new), values)


def crumbs(count):
    """Scatters bits of mandible in the air in front of the face."""

    def change(values):
        rng = np.random.default_rng(0)
        free = np.argwhere((values == 0) & (np.arange(values.shape[1])[None, :, None] < 4))
        values[tuple(free[rng.permutation(len(free))[:count]].T)] = 2
        return values

    return change


def halves(values):
    middle = values.shape[2] // 2
    gap = np.isin(values, (2, 4, 5))
    gap[:, :, : middle - 1] = gap[:, :, middle + 2 :] = False
    values[gap] = 0
    return values


def streaks(values):
    """Bright and dark bands across the teeth, as metal makes them."""
    bone = np.argwhere(values > 600)
    level = int(np.median(bone[bone[:, 1] < bone[:, 1].min() + 4, 0]))
    rng = np.random.default_rng(1)
    for _ in range(12):
        z, y = level + rng.integers(-2, 3), rng.integers(4, values.shape[1] // 2)
        values[z, y] += rng.choice([-350, 700])
    return values


def holder(values):
    values[:, -2:, :] = 200
    return values


def joined(values):
    """Lips that touch: the slit between them closed."""
    solid = ndimage.grey_closing(values, (5, 1, 1))
    return np.where(values < -400, solid, values).astype(values.dtype)


def with_nan(values):
    values[3, 3, 3] = np.nan
    return values


# Name: what makes it of the pair, settings of the import, words of the refusal (None: imported), where the chin lies.
SAME, ANYWHERE = "same", "anywhere"
VARIANTS = {
    "as it is": (lambda p: p, {}, None, SAME),
    "stored right to left, front to back, head first (RAS)": (
        lambda p: [sitk.DICOMOrient(i, "RAS") for i in p], {}, None, SAME),
    "axes in another order (SAL)": (lambda p: [sitk.DICOMOrient(i, "SAL") for i in p], {}, None, SAME),
    "scanned on an oblique grid, 15 degrees": (lambda p: regridded(p, direction=turned((1, 0, 0), 15)), {}, None, SAME),
    "head tilted by 20 degrees": (lambda p: header(p, direction=turned((1, 0, 0), 20)), {}, None, ANYWHERE),
    "head turned by 15 degrees": (lambda p: header(p, direction=turned((0, 0, 1), 15)), {}, None, ANYWHERE),
    "slices of 5 mm, pixels of 2 mm": (lambda p: regridded(p, spacing=(2.0, 2.0, 5.0)), {}, None, SAME),
    "finer voxels than needed": (lambda p: regridded(p, spacing=(1.5,) * 3), {}, None, SAME),  # merged to 2 mm here
    "wrong header, corrected by `orientation`": (
        lambda p: header(p, direction=np.diag([-1, -1, 1])), {"orientation": "LPS"}, None, ANYWHERE),
    "turned by 180 degrees (face backwards)": (
        lambda p: header(p, direction=np.diag([-1, -1, 1])), {}, "looks backwards", None),
    "slices reversed (upside down)": (lambda p: header(p, direction=np.diag([1, 1, -1])), {}, "upside down", None),
    "lying on its side": (
        lambda p: header(p, direction=turned((0, 1, 0), 90)), {}, "lies on its side|upper teeth lie below", None),
    "mirrored, and teeth tell the sides": (
        lambda p: header(changed(p, sided), direction=np.diag([-1, 1, 1])),
        {"preset": "universal"}, "left and right are exchanged", None),
    "mirrored, and nothing tells the sides": (lambda p: header(p, direction=np.diag([-1, 1, 1])), {}, None, ANYWHERE),
    "metres": (lambda p: header(p, spacing=(SPACING / 1000,) * 3), {}, "metres", None),
    "slices twice as far apart": (
        lambda p: header(p, spacing=(SPACING, SPACING, 2 * SPACING)), {}, "of its width", None),
    "pixels half as large": (
        lambda p: header(p, spacing=(SPACING / 2, SPACING / 2, SPACING)), {}, "wide|of its width", None),
    "field of view ends at the brow": (lambda p: cropped(p, brow=30), {}, None, SAME),
    "field of view ends behind the rami": (lambda p: cropped(p, back=9), {}, None, ANYWHERE),
    "field of view ends in the chin": (lambda p: cropped(p, chin=36), {}, None, ANYWHERE),
    "metal streaks in the scan": (lambda p: changed(p, scan=streaks), {}, None, SAME),
    "head holder in the scan": (lambda p: changed(p, scan=holder), {}, None, SAME),
    "lips that touch": (lambda p: changed(p, scan=joined), {}, None, SAME),
    "grey values of a cone-beam CT (0 to 255)": (
        lambda p: changed(p, scan=lambda v: ((v + 1000) / 1900 * 255).astype(np.float32)), {}, None, SAME),
    "few loose voxels of bone": (lambda p: changed(p, crumbs(80)), {}, None, SAME),
    "many loose voxels of bone": (lambda p: changed(p, crumbs(900)), {}, "stray voxels", None),
    "mandible in two halves": (lambda p: changed(p, halves), {}, "in pieces|would|cm3|cut leaves", None),
    "no mandible": (lambda p: changed(p, replaced(2, 1)), {}, "no mandible is labelled", None),
    "no teeth labelled": (
        lambda p: changed(p, lambda v: replaced(3, 1)(replaced(4, 2)(v))), {}, "give the points ANS and PNS", None),
    "teeth exchanged": (
        lambda p: changed(p, lambda v: replaced(9, 4)(replaced(4, 3)(replaced(3, 9)(v)))), {},
        "upper teeth lie below", None),
    "a value that the tool does not write": (
        lambda p: changed(p, replaced(5, 17)), {}, "17, which the tool does not write", None),
    "labels of another tool": (lambda p: p, {"preset": "universal"}, "no skull is labelled", None),
    "no scan": (lambda p: [p[0], None], {}, "there is no scan", None),
    "scan in another frame": (
        lambda p: [p[0], header([p[1]], direction=np.diag([1, 1, -1]))[0]], {}, "not brighter|soft tissue", None),
    "NaN in the scan": (lambda p: changed(p, scan=with_nan), {}, "NaN or infinite", None),
}  # fmt: skip


def sided(values):
    """Teeth numbered by side, as they lie before the mirror."""
    left = np.arange(values.shape[2])[None, None, :] > values.shape[2] / 2
    upper, lower = values == 3, values == 4
    for old, new in ((1, 54), (2, 53), (5, 55)):
        values[values == old] = new
    values[upper & left], values[upper & ~left] = 9, 8
    values[lower & left], values[lower & ~left] = 24, 25
    return values


# Share of the jaw's volume that a variant may change, where it is not 7 %.
LOST = {
    "field of view ends in the chin": 0.25,
    "field of view ends behind the rami": 0.15,
    "slices of 5 mm, pixels of 2 mm": 0.1,
}


@pytest.mark.parametrize("name", VARIANTS)
def test_a_variant_is_the_head_or_is_refused(name, pair, reference, tmp_path, monkeypatch):
    make, settings, words, place = VARIANTS[name]
    if words:
        with pytest.raises(InputError, match=words) as caught:
            measured(make(pair), tmp_path, **settings)
        assert len(caught.value.remedy) > 10 and not (tmp_path / "out").exists()
        return
    monkeypatch.setattr(head_parts, "VOXEL", 2.0)
    jaw, soft, chin, said = measured(make(pair), tmp_path, **settings)
    loss = LOST.get(name, 0.07)
    assert abs(jaw / reference[0] - 1) < loss, (jaw, reference[0])
    assert soft > 0.5 * reference[1] if place == ANYWHERE or "brow" in name else abs(soft / reference[1] - 1) < 0.12
    if place == SAME:
        assert np.linalg.norm(chin - reference[2]) < 6
    if "field of view" in name and "brow" not in name:
        assert said["frame"]["size"].startswith("unknown in part")
    assert "nothing labelled tells left from right" in said["frame"]["sides"]  # what no check can know is said


def test_the_page_lists_them_all():
    page = (ROOT / "docs/lab/heads.md").read_text(encoding="utf-8")
    listed = dict(re.findall(r"^\| (.+?) \| (the head|refused)(?:: .*)? \|$", page, re.M))
    assert listed == {name: "refused" if words else "the head" for name, (_, _, words, _) in VARIANTS.items()}
    assert len(listed) >= 20
