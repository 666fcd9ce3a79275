"""The size of a volume is read from its header, and what has none counts as nothing."""

import numpy as np
import pytest
import SimpleITK as sitk

from pinnochio.volume_size import millions, voxels


@pytest.mark.parametrize("name", ["a.nii", "a.nii.gz", "a.nrrd", "a.mha"])
def test_the_voxels_of_a_file_are_those_of_its_header(name, tmp_path):
    image = sitk.GetImageFromArray(np.zeros((7, 60, 51), np.uint8))
    sitk.WriteImage(image, str(tmp_path / name))
    assert voxels(tmp_path / name) == 7 * 60 * 51 and millions(tmp_path / name) == 1
    (tmp_path / name).write_bytes((tmp_path / name).read_bytes()[:9])
    assert voxels(tmp_path / name) == 0


def test_what_is_no_volume_has_no_voxels(tmp_path):
    (tmp_path / "a.dcm").write_bytes(b"DICM")
    assert [millions(tmp_path / name) for name in ("a.dcm", "none.nii.gz", "")] == [0, 0, 0]
