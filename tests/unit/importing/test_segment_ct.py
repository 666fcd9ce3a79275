"""Bones of a CT parted by a threshold and three planes."""

import json

import numpy as np
import pytest
import SimpleITK as sitk
from segment_ct import segment_ct

from pinnochio.errors import InputError
from pinnochio.importing.presets import MANDIBLE, SKULL
from tests.helpers.settings import ROOT

CT = ROOT.parent / "shared/data/headsq/headsq_quarter.nrrd"
PLANES = {
    "occlusal": ([20, 15, 20], [0, 0, 1]),
    "pterygoid": ([20, 36, 20], [0, 1, 0]),
    "joint": ([20, 48, 32], [0, 0, 1]),
}


@pytest.fixture
def head(tmp_path):
    """A made head in voxels of 2 mm: upper block, lower block, and a ramus that meets the upper through a dim joint."""
    density = np.zeros((20, 30, 24), np.float32)
    density[3:17, 2:22, 11:20] = 2000
    density[3:17, 22:28, 17:20] = 2000
    density[3:17, 2:22, 3:10] = 2000
    density[3:17, 22:28, 3:10] = 2000
    density[3:17, 24:28, 10:16] = 2000
    density[3:17, 24:28, 16] = 1600  # joint
    density[3:17, 5:18, 10] = 1900  # teeth in contact
    path = tmp_path / "ct.nrrd"
    image = sitk.GetImageFromArray(density.transpose(2, 1, 0))
    image.SetSpacing([2, 2, 2])
    sitk.WriteImage(image, str(path))
    return path


def planes(folder, **changed):
    listed = [{"type": "Plane", "name": n, "center": c, "normal": v} for n, (c, v) in (PLANES | changed).items()]
    path = folder / "planes.mrk.json"
    path.write_text(json.dumps({"markups": listed}))
    return path


def test_jaws_are_parted_at_teeth_and_joints(head, tmp_path):
    segment_ct(str(head), planes(tmp_path), 1500, str(tmp_path / "P01"), spacing=2.0)
    image = sitk.ReadImage(str(tmp_path / "P01/segmentation.nii.gz"))
    made = sitk.GetArrayFromImage(image).transpose(2, 1, 0)
    assert (made[3:17, 2:22, 12:20] == SKULL).all() and (made[3:17, 2:22, 3:9] == MANDIBLE).all()
    assert (made[4:16, 25:27, 4:15] == MANDIBLE).all() and (made[3:17, 22:28, 18:20] == SKULL).all()
    scan = tmp_path / "P01/ct.nii.gz"
    assert sitk.ReadImage(str(scan)).GetSize() == image.GetSize()
    with pytest.raises(InputError, match="would take its place"):
        segment_ct(str(scan), planes(tmp_path), 1500, str(scan.parent))


def test_planes_that_do_not_fit_are_refused(head, tmp_path):
    with pytest.raises(InputError, match="no bone below the occlusal plane"):
        segment_ct(str(head), planes(tmp_path, occlusal=([0, 0, -50], [0, 0, 1])), 1500, str(tmp_path / "P01"))
    path = planes(tmp_path)
    path.write_text(path.read_text().replace("joint", "hinge"))
    with pytest.raises(InputError, match="no plane 'joint'"):
        segment_ct(str(head), path, 1500, str(tmp_path / "P01"))
    assert not (tmp_path / "P01").exists()


@pytest.mark.skipif(not CT.is_file(), reason="the CT is not there")
def test_the_bones_of_the_real_ct_are_those_of_its_label_map(tmp_path):
    drawn = ROOT / "examples/headsq/planes.mrk.json"
    segment_ct(str(CT), drawn, 1200, str(tmp_path / "P01"), orientation="LPI", spacing=1.5)
    known = sitk.ReadImage(str(ROOT / "examples/headsq/labels.nii.gz"))
    made = sitk.Resample(
        sitk.ReadImage(str(tmp_path / "P01/segmentation.nii.gz")), known, sitk.Transform(), sitk.sitkNearestNeighbor
    )
    made, known = sitk.GetArrayFromImage(made), sitk.GetArrayFromImage(known)
    for part, codes in ((SKULL, (10, 11)), (MANDIBLE, (12, 13, 14))):
        one, other = made == part, np.isin(known, codes)
        assert 2 * (one & other).sum() > 0.99 * (one.sum() + other.sum())
