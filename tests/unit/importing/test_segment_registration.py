"""Bones of a virtual head, moved by known motions and scanned: the motions are found again, and wrong bones refused."""

from dataclasses import replace

import numpy as np
import pytest
import SimpleITK as sitk
from scipy.spatial.transform import Rotation

from pinnochio.errors import InputError
from pinnochio.geometry.rigid import RigidMotion
from pinnochio.importing.postop_bones import read_postop_bones
from pinnochio.importing.segment_registration import SegmentFit, check_fits, register_bones
from pinnochio.importing.segmentation import Segmentation, write_segmentation
from pinnochio.model.labels import CRANIUM, segment_code
from pinnochio.model.surfaces import bone_surface, write_surface
from pinnochio.plans.plan import Plan
from pinnochio.tables.segments import motion_errors
from pinnochio.virtual.bone_scan import scan_bones
from pinnochio.virtual.head import SEGMENTS
from tests.helpers.virtual_heads import virtual_head

TRUE = Plan(
    "P1",
    {
        "lefort1": RigidMotion.from_degrees((2, -1, 1.5), (1.0, -5.0, 2.0), (0, -80, -40)),
        "mandible_distal": RigidMotion.from_degrees((-2.5, 1, 1), (-1.0, -7.0, 1.0), (0, -60, -60)),
        "proximal_left": RigidMotion.from_degrees((-2, 0.5, 1), (0.3, -0.5, 0), (50, -10, -4)),
        "proximal_right": RigidMotion.from_degrees((1.5, -1, 0.5), (0, 0.5, -0.3), (-50, -10, -4)),
    },
)
LIMITS = {"limit": 0.45, "share": 70.0, "case": "P1", "file": "bones"}
# What was planned: a millimetre or two and a degree or two away.
PLANNED = Plan(
    "P1",
    {
        name: RigidMotion.from_degrees(
            motion.degrees + [1.2, -0.6, 0.6], motion.translation + [0.8, 1.5, -1.0], motion.pivot
        )
        for name, motion in TRUE.motions.items()
    },
)  # fmt: skip


def head_of(deformity: str):
    head = virtual_head(deformity, 1.5)
    return Segmentation(head.labels, head.spacing, head.origin, head.segments)


@pytest.fixture(scope="module")
def head():
    return head_of("asymmetry")


@pytest.fixture(scope="module")
def bone(head):
    return bone_surface(head.labels, head.spacing, head.origin, SEGMENTS, 3.0)


def surface(head, folder, artefacts, executed=TRUE, change=None):
    """The scanned bones as read from a label map, which `change` alters."""
    scan = scan_bones(head, executed, np.random.default_rng(3), artefacts)
    labels = scan.labels if change is None else change(scan.labels)
    write_segmentation(labels, scan.spacing, scan.origin, folder / "bones.nii.gz")
    return read_postop_bones(folder / "bones.nii.gz", "P1", np.zeros((0, 3)))


@pytest.fixture(scope="module")
def clean(head, tmp_path_factory):
    return surface(head, tmp_path_factory.mktemp("clean"), 0.0)


@pytest.fixture(scope="module")
def noisy(head, tmp_path_factory):
    return surface(head, tmp_path_factory.mktemp("noisy"), 1.0)


def errors(head, bone, points, faces, planned=PLANNED):
    """Errors of the motions by segment, and all fits."""
    cranium, fits = register_bones(head, SEGMENTS, planned, points, faces, case="P1", file="bones")
    plan = Plan("P1", {fit.segment: fit.motion for fit in fits})
    return motion_errors(plan, TRUE, bone), [cranium, *fits]


def largest(errors, key="error_max"):
    return max(error[key] for error in errors.values())


def test_clean_bones_give_the_motions_back(head, bone, clean, from_in_place):
    off, fits = errors(head, bone, *clean)
    assert set(off) == set(SEGMENTS)
    assert largest(off) < 0.25 and largest(off, "error_degrees") < 0.5
    assert all(fit.median < 0.15 and fit.matched > 90 for fit in fits)
    check_fits(fits, **LIMITS)
    with pytest.raises(InputError, match="'cranium' registered .*at least 100 % is asked"):
        check_fits(fits, **LIMITS | {"share": 100.0})


@pytest.mark.parametrize(
    ("turn", "planned"),
    [
        pytest.param((165, -30, 20), PLANNED, id="upside down"),
        pytest.param((80, 80, -100), Plan("P1", {}), id="on its side, without a plan", marks=pytest.mark.full),
    ],
)
def test_noise_plates_callus_and_streaks_in_any_frame(head, bone, noisy, turn, planned):
    points, faces = noisy
    rotation = Rotation.from_rotvec(turn, degrees=True).as_matrix()
    off, fits = errors(head, bone, points @ rotation.T + [300.0, -80, 1200], faces, planned)
    assert largest(off, "error_mean") < 0.35 and largest(off) < 0.6 and largest(off, "error_degrees") < 1.0
    assert all(0.05 < fit.median < 0.4 < fit.p90 < 1.5 for fit in fits)
    check_fits(fits, **LIMITS)
    if planned is PLANNED:
        assert fits[1].from_plan == pytest.approx(2, abs=1) and fits[1].from_plan_degrees == pytest.approx(1.5, abs=0.8)


def test_a_third_out_of_view_costs_little_and_what_is_not_seen_is_refused(head, bone, tmp_path, from_in_place):
    """The left of the head is missing up to the left orbit, and with it the left proximal segment."""

    def cut(labels):
        return labels[: int(0.7 * len(labels))]

    off, fits = errors(head, bone, *surface(head, tmp_path, 1.0, change=cut))
    assert max(error["error_max"] for name, error in off.items() if name != "proximal_left") < 0.9
    with pytest.raises(InputError, match=r"'P1'.*bones.*'proximal_left'.* [0-9.]+ mm .*Remedy"):
        check_fits([fit for fit in fits if fit.segment == "proximal_left"], **LIMITS)


def test_a_segment_that_the_case_does_not_have_has_no_motion(head, clean, from_in_place):
    labels = np.where(head.labels == segment_code(0), CRANIUM, head.labels)
    still = Plan("P1", {name: motion for name, motion in TRUE.motions.items() if name != "lefort1"})
    changed = Segmentation(labels, head.spacing, head.origin)
    _, fits = register_bones(changed, SEGMENTS, still, *clean, case="P1", file="bones")
    assert [fit.segment for fit in fits] == list(SEGMENTS[1:])


def assert_refused(fits):
    with pytest.raises(InputError, match=r"'P1'.*bones.*median distance of [0-9.]+ mm .limit 0.45.*Remedy: .+"):
        check_fits(fits, **LIMITS)


@pytest.mark.full
def test_a_mirrored_patient_is_refused(head, bone, noisy):
    points, faces = noisy
    assert_refused(errors(head, bone, points * [-1, 1, 1], faces[:, ::-1])[1])


@pytest.mark.full
def test_another_patient_is_refused(head, bone, tmp_path, from_in_place):
    assert_refused(errors(head, bone, *surface(head_of("class_ii"), tmp_path, 1.0))[1])


@pytest.mark.parametrize("wrong", ["limit", "share", "median", "matched"])
def test_what_is_no_number_lets_no_bone_through(wrong):
    """Neither a bound nor a measure of the fit."""
    moved = RigidMotion(translation=np.array([0, -3.0, 0]))
    fit = SegmentFit("lefort1", moved, 800, 0.15, 0.3, 95.0, 1.0, 1.0)
    check_fits([fit], **LIMITS)
    limits = LIMITS | ({wrong: np.nan} if wrong in LIMITS else {})
    unsure = fit if wrong in LIMITS else replace(fit, **{wrong: np.nan})
    with pytest.raises(InputError, match=r"'P1'.*bones.*'lefort1'.*nan.*Remedy"):
        check_fits([fit, unsure], **limits)


def test_the_bones_before_surgery_are_no_bones_after_it():
    """They fit better than any scan, and say that nothing has moved."""
    fits = [
        SegmentFit(
            "cranium", RigidMotion.from_degrees((40, 0, 9), (80, 0, 0), (0, 0, 0)), 800, 0.07, 0.2, 99.0, 0.0, 0.0
        ),
        SegmentFit(
            "lefort1", RigidMotion.from_degrees((0.1, 0, 0), (0.05, 0, 0), (0, 0, 0)), 800, 0.09, 0.2, 99.0, 1.6, 1.0
        ),
        SegmentFit("mandible_distal", RigidMotion(), 800, 0.09, 0.2, 99.0, 9.4, 1.0),
    ]
    words = (
        r"'P1': bones: every segment is where it was .*'mandible_distal' 9\.4 mm from where the plan.*Remedy: give the"
    )
    with pytest.raises(InputError, match=words):
        check_fits(fits, **LIMITS)
    moved = RigidMotion(translation=np.array([0, 0.5, 0]))
    check_fits([*fits[:2], replace(fits[2], motion=moved)], **LIMITS)
    check_fits([fits[0], *(replace(fit, from_plan=0.2) for fit in fits[1:])], **LIMITS)  # and nothing was to move


def test_a_surface_with_a_point_far_off_is_refused_before_it_is_divided(bone, tmp_path):
    points = bone.points.copy()
    points[7] += [1e5, 0, 0]
    write_surface(points, bone.faces, tmp_path / "bones.ply")
    with pytest.raises(InputError, match=r"'P1'.*its edges are up to 1e\+05 mm long; .* triangles.*Remedy: remove"):
        read_postop_bones(tmp_path / "bones.ply", "P1", bone.points)


@pytest.mark.parametrize("bone", [np.ones((20, 20, 20)), np.pad(np.ones((1, 1, 1)), 9)], ids=["all", "a voxel"])
def test_a_volume_whose_bone_has_no_surface_is_refused(bone, tmp_path):
    sitk.WriteImage(sitk.GetImageFromArray(bone.astype(np.uint8)), str(tmp_path / "bones.nrrd"))
    with pytest.raises(InputError, match="'P1'.*its bone has no surface.*Remedy: label"):
        read_postop_bones(tmp_path / "bones.nrrd", "P1", np.zeros((0, 3)))


def test_surfaces_in_centimetres_and_folders_of_them_are_the_same_bones(head, bone, clean, tmp_path, from_in_place):
    points, faces = clean
    write_surface(points / 10, faces, tmp_path / "bones.ply")
    (tmp_path / "parts").mkdir()
    middle = points[faces].mean(axis=1)[:, 2] > np.median(points[:, 2])
    for name, half in (("upper", middle), ("lower", ~middle)):
        write_surface(points, faces[half], tmp_path / f"parts/{name}.stl")
    for name in ("bones.ply", "parts"):
        off, _ = errors(head, bone, *read_postop_bones(tmp_path / name, "P1", bone.points))
        assert largest(off) < 0.25, name


def test_what_is_read_is_open_at_the_border_and_looks_outward(tmp_path):
    """A block that leaves the volume at the top; its normals look away from its middle."""
    labels = np.zeros((20, 20, 20), np.uint8)
    labels[5:15, 5:15, 8:] = 7
    for direction in (np.eye(3), np.diag([-1.0, 1, 1])):  # the second grid is left-handed
        image = sitk.GetImageFromArray(labels.transpose(2, 1, 0))
        image.SetDirection(direction.ravel())
        sitk.WriteImage(image, str(tmp_path / "block.nrrd"))
        points, faces = read_postop_bones(tmp_path / "block.nrrd", "P1", np.zeros((0, 3)))
        upright = points @ direction
        assert upright[:, 2].max() < 19.6 and np.isclose(upright[:, 2].min(), 7.5, atol=0.3)
        corners = points[faces]
        normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        lower = upright[faces].mean(axis=1)[:, 2] < 8
        assert lower.sum() > 50 and ((normals @ direction)[lower, 2] < 0).mean() > 0.95
