"""Two arches in final occlusion, cut from a finer head and put into a scanner's frame, give the motion back."""

import numpy as np
import pytest

from pinnochio.errors import InputError
from pinnochio.geometry.rigid import RigidMotion
from pinnochio.importing.occlusion import read_occlusion
from pinnochio.importing.segmentation import write_segmentation
from pinnochio.model.surfaces import bone_surface
from pinnochio.plans.plan import Plan
from pinnochio.plans.transforms import write_transforms
from scripts.patient.import_plan import import_plan
from tests.helpers import tools
from tests.helpers.virtual_heads import virtual_head

INTO_BITE = RigidMotion.from_degrees((2, -1, 1.5), (1.0, -5, 1.5), (0, -60, -60))
MAXILLA = RigidMotion.from_degrees((1, 0, -2), (0, -4, 2), (0, -70, -30))
TOLERANCE = 1.0  # mm anywhere on the mandible; smooth arches of voxels of 2 mm hold less than teeth
JAW = "mandible_distal"


@pytest.fixture(scope="module")
def head():
    return virtual_head("asymmetry", 2.0)


@pytest.fixture(scope="module")
def arches():
    return tools.arches(virtual_head("asymmetry", 1.5), INTO_BITE)


def test_the_mandible_goes_where_its_arch_lies_under_a_maxilla_that_moves_too(head, arches, tmp_path):
    folder = tools.save_arches(tmp_path / "final", arches, ("UpperJawScan", "LowerJawScan"))
    write_transforms({"lefort1": MAXILLA, "proximal_left": RigidMotion()}, folder)
    bone_surface(head.labels, head.spacing, head.origin, head.segments).write(tmp_path / "bone.vtp")
    write_segmentation(head.labels, head.spacing, head.origin, tmp_path / "labels.nii.gz")
    out = tmp_path / "plan.json"
    import_plan("P", str(folder), str(tmp_path / "bone.vtp"), str(out), str(tmp_path / "labels.nii.gz"))
    plan, points = Plan.read(out, "P"), np.argwhere(head.labels == 12)[::50] * head.spacing + head.origin
    off = plan.motion(JAW).apply(points) - MAXILLA.apply(INTO_BITE.apply(points))
    assert np.linalg.norm(off, axis=1).max() < TOLERANCE and plan.motion("proximal_left").angle == 0
    assert 0.1 < plan.motion("proximal_right").angle < 5  # it follows about its condyle
    assert "proximal_right follow the mandible" in plan.warnings[0]
    (folder / "LowerJawScan.stl").rename(folder / "bone.stl")
    with pytest.raises(InputError, match="says nothing of 'mandible_distal'"):  # bones beside transforms are no arches
        import_plan("P", str(folder), str(tmp_path / "bone.vtp"), str(out), str(tmp_path / "labels.nii.gz"))
    (folder / "bone.stl").rename(folder / "lower.stl")
    write_transforms({JAW: MAXILLA}, folder)
    with pytest.raises(InputError, match="has a transform beside the arches"):
        read_occlusion(folder, "P", head, head.segments)


@pytest.mark.parametrize("wrong", ["one", "exchanged", "mirrored", "apart"])
def test_arches_that_tell_nothing_are_refused(head, arches, tmp_path, wrong):
    names, scans, words = ("upper", "lower"), dict(arches), "registered on the teeth"
    if wrong == "one":
        del scans["lower"]
        words = "keep two scans"
    elif wrong == "exchanged":
        names = ("lower", "upper")
    elif wrong == "mirrored":
        scans = {name: (points * [-1, 1, 1], faces) for name, (points, faces) in scans.items()}
    else:
        scans["lower"], words = (scans["lower"][0] + [60.0, 0, 0], scans["lower"][1]), "hardly any of it"
    with pytest.raises(InputError, match=words):
        read_occlusion(tools.save_arches(tmp_path / "final", scans, names), "P", head, head.segments)
