"""The motion that was achieved, from AReg's matrices of two scans, and what is refused."""

import numpy as np
import pytest
import SimpleITK as sitk

from pinnochio.errors import InputError
from pinnochio.geometry.rigid import RigidMotion
from pinnochio.plans.areg import matrices, read_areg

SEGMENTS = ("lefort1", "mandible_distal", "proximal_left", "proximal_right")
POINTS = np.random.default_rng(1).normal([0, -60, -20], 30, (20, 3))
TRUE = {
    "lefort1": RigidMotion.from_degrees([2, -1, 3], [0.5, -4.0, 1.0], [0.0, -50.0, 0.0]),
    "mandible_distal": RigidMotion.from_degrees([-4, 1, 2], [1.0, 6.0, -2.0], [0.0, -40.0, -30.0]),
}
HEAD = RigidMotion.from_degrees([10, -25, 40], [120.0, -80.0, 60.0], [0.0, 0.0, 0.0])  # to the second scan's frame


def scanned(folder, regions=("CB", "MAX", "MAND"), name="P1_{}Reg_matrix.tfm"):
    """Matrices as AReg's registration finds them: from a bone in the first scan to the same bone in the second."""
    bones = {"CB": RigidMotion(), "MAX": TRUE["lefort1"], "MAND": TRUE["mandible_distal"]}
    for region in regions:
        file = sitk.Euler3DTransform()
        rotation = HEAD.rotation @ bones[region].rotation
        file.SetMatrix(rotation.ravel().tolist())
        file.SetTranslation(HEAD.apply(bones[region].apply(np.zeros((1, 3))))[0].tolist())
        path = folder / name.format(region)
        sitk.WriteTransform(file, str(path))
    return folder


@pytest.mark.parametrize("name", ["P1_{}Reg_matrix.tfm", "P1_{}_Reg_matrix.tfm", "P_CB_1_{}_matrix.tfm"])
def test_each_jaw_moves_as_it_did_in_the_frame_before_surgery(tmp_path, name):
    plan = read_areg(scanned(tmp_path, name=name), "P1", SEGMENTS)
    assert tuple(plan.motions) == SEGMENTS and not plan.motion("proximal_left").displacement(POINTS).any()
    for segment, motion in TRUE.items():
        np.testing.assert_allclose(plan.motion(segment).apply(POINTS), motion.apply(POINTS), atol=1e-9)


def test_an_uncut_mandible_and_one_jaw_alone_are_read_and_the_rest_is_said(tmp_path, caplog):
    plan = read_areg(scanned(tmp_path, ("CB", "MAND")), "P1", ("lefort1", "mandible"))
    np.testing.assert_allclose(plan.motion("mandible").apply(POINTS), TRUE["mandible_distal"].apply(POINTS), atol=1e-9)
    assert "no matrix of lefort1" in caplog.text


@pytest.mark.parametrize(
    ("regions", "segments", "said"),
    [
        (("MAX", "MAND"), SEGMENTS, "cranial base"),
        (("CB",), SEGMENTS, "a jaw"),
        (("CB", "MAX"), ("lefort1_left", "lefort1_right", "mandible"), "lefort1_left, lefort1_right"),
        (("CB", "MAX"), ("mandible",), "no segment"),
        (("CB", "MAND"), (*SEGMENTS, "chin"), "mandible_distal, chin"),
    ],
)
def test_what_is_ambiguous_is_refused(tmp_path, regions, segments, said):
    with pytest.raises(InputError, match=said):
        read_areg(scanned(tmp_path, regions), "P1", segments)


def test_two_patients_in_one_folder_are_refused(tmp_path):
    scanned(tmp_path)
    scanned(tmp_path, name="P2_{}Reg_matrix.tfm")
    with pytest.raises(InputError, match="of the same region"):
        read_areg(tmp_path, "P1", SEGMENTS)


def test_other_transforms_are_no_matrices_of_areg(tmp_path):
    (tmp_path / "mandible.tfm").touch()
    (tmp_path / "CBreg.tfm").touch()
    assert not matrices(tmp_path) and not matrices(tmp_path / "mandible.tfm")
