"""Plans as ITK and 3D Slicer transforms: their direction and frame, every rigid type, and what is refused."""

import h5py
import numpy as np
import pytest
import SimpleITK as sitk
from scipy.spatial.transform import Rotation

from pinnochio.errors import InputError
from pinnochio.geometry.rigid import RigidMotion
from pinnochio.plans.plan import Plan
from pinnochio.plans.transforms import write_transforms

POINTS = np.random.default_rng(1).normal([20, -350, 900], 60, (30, 3))
TURN = Rotation.from_rotvec([7, -3, 12], degrees=True).as_matrix()
CENTRE, SHIFT = (40.0, -300.0, 850.0), (1.0, 6.0, -2.0)


def slicer_file(parameters, kind="AffineTransform_double_3_3", fixed="0 0 0"):
    """The text that 3D Slicer writes for a linear transform node."""
    return (
        f"#Insight Transform File V1.0\n#Transform 0\nTransform: {kind}\n"
        f"Parameters: {' '.join(map(str, parameters))}\nFixedParameters: {fixed}\n"
    )


def motion_of(folder, segment="mandible"):
    return Plan.read(folder, "P1").motion(segment)


def save(transform, folder, suffix="tfm", segment="mandible"):
    sitk.WriteTransform(transform, str(folder / f"{segment}.{suffix}"))
    return folder


@pytest.mark.parametrize("suffix", ["tfm", "txt"])
def test_a_slicer_node_that_moves_the_mandible_5_mm_forward_moves_it_5_mm_forward(tmp_path, suffix):
    """Slicer shows the translation (0, 5, 0) in RAS and writes it inverted and in LPS: (0, 5, 0) again."""
    (tmp_path / f"mandible.{suffix}").write_text(slicer_file([1, 0, 0, 0, 1, 0, 0, 0, 1, 0, 5, 0]))
    moved = motion_of(tmp_path).apply(POINTS)
    np.testing.assert_allclose(moved - POINTS, np.tile([0.0, -5.0, 0.0], (len(POINTS), 1)), atol=1e-12)


def test_a_slicer_node_that_turns_left_turns_left(tmp_path):
    """To-parent matrix M in RAS; the file holds the inverse of D M D, D = diag(-1, -1, 1)."""
    to_parent = np.eye(4)
    to_parent[:3, :3], to_parent[:3, 3] = TURN, [2.0, 8.0, -3.0]
    flip = np.diag([-1.0, -1.0, 1.0, 1.0])
    stored = np.linalg.inv(flip @ to_parent @ flip)
    (tmp_path / "mandible.tfm").write_text(slicer_file([*stored[:3, :3].ravel(), *stored[:3, 3]]))
    ras = POINTS * [-1, -1, 1]
    wanted = (ras @ TURN.T + [2.0, 8.0, -3.0]) * [-1, -1, 1]
    np.testing.assert_allclose(motion_of(tmp_path).apply(POINTS), wanted, atol=1e-9)


def placed(made):
    made.SetMatrix(TURN.ravel().tolist())
    made.SetCenter(CENTRE)
    made.SetTranslation(SHIFT)
    return made


def affine():
    return placed(sitk.AffineTransform(3))


RIGID = {
    "euler": lambda: sitk.Euler3DTransform(CENTRE, 0.1, -0.05, 0.2, SHIFT),
    "versor": lambda: placed(sitk.VersorRigid3DTransform()),
    "affine": affine,
    "translation": lambda: sitk.TranslationTransform(3, SHIFT),
    "identity": lambda: sitk.Transform(3, sitk.sitkIdentity),
    "composite": lambda: sitk.CompositeTransform([affine()]),
    "similarity": lambda: sitk.Similarity3DTransform(1.0, (0.0, 0.0, 1.0), 0.2, SHIFT, CENTRE),
    "half a turn": lambda: sitk.Euler3DTransform(CENTRE, 0.0, 0.0, np.pi, SHIFT),
}


# ITK cannot write a composite into a .mat.
STORED = [(kind, suffix) for kind in RIGID for suffix in ("tfm", "h5", "mat") if (kind, suffix) != ("composite", "mat")]


@pytest.mark.parametrize(("kind", "suffix"), STORED)
def test_any_rigid_transform_is_undone_exactly(tmp_path, kind, suffix):
    transform = RIGID[kind]()
    motion = motion_of(save(transform, tmp_path, suffix))
    back = np.array([transform.TransformPoint(point) for point in motion.apply(POINTS).tolist()])
    np.testing.assert_allclose(back, POINTS, atol=1e-8)
    np.testing.assert_allclose(motion.rotation.T @ motion.rotation, np.eye(3), atol=1e-12)


def test_the_affine_of_ants_is_read(tmp_path):
    entry = slicer_file([1, 0, 0, 0, 1, 0, 0, 0, 1, 0, 5, 0], "MatrixOffsetTransformBase_double_3_3", "1 2 3")
    (tmp_path / "mandible.tfm").write_text(entry)
    np.testing.assert_allclose(motion_of(tmp_path).displacement(POINTS), np.tile([0, -5, 0], (30, 1)), atol=1e-12)


def test_a_far_centre_neither_refuses_nor_spoils_a_small_turn(tmp_path):
    """5 degrees about a condyle far from the scanner's origin: a long offset in the file, a short way of the bone."""
    condyle = np.array([50.0, -420.0, 780.0])
    turn = Rotation.from_rotvec([5, 0, 0], degrees=True).as_matrix()
    stored = [*turn.T.ravel(), *(condyle - turn.T @ condyle)]
    assert np.linalg.norm(stored[9:]) > 70
    (tmp_path / "mandible.tfm").write_text(slicer_file(stored))
    motion = motion_of(tmp_path)
    chin = condyle + [0, -90.0, -60.0]
    np.testing.assert_allclose(motion.apply(chin[None])[0], condyle + turn @ (chin - condyle), atol=1e-9)
    # Half of it is half the turn about the condyle, and as JSON the plan is accepted, too.
    np.testing.assert_allclose(motion.fraction(0.5).apply(condyle[None])[0], condyle, atol=1e-9)
    plan = Plan.from_json(Plan.read(tmp_path, "P1").to_json(), "plan.json", "P1")
    np.testing.assert_allclose(plan.motion("mandible").apply(POINTS), motion.apply(POINTS), atol=1e-9)


def test_single_precision_is_rigid_enough_and_made_exact(tmp_path):
    rounded = TURN.astype(np.float32).astype(str).ravel()
    (tmp_path / "mandible.tfm").write_text(slicer_file([*rounded, 1, 2, 3], "AffineTransform_float_3_3"))
    motion = motion_of(tmp_path)
    np.testing.assert_allclose(motion.rotation @ motion.rotation.T, np.eye(3), atol=1e-12)
    np.testing.assert_allclose(motion.apply(POINTS) @ TURN.T + [1, 2, 3], POINTS, atol=1e-3)


def test_written_transforms_come_back_and_slicer_reads_the_inverse(tmp_path):
    plan = Plan(
        "P1",
        {
            "lefort1": RigidMotion.from_degrees((10, -4, 25), (1.0, -5.0, 2.0), (3.0, 40.0, -7.0)),
            "mandible_distal": RigidMotion(translation=np.array([0.0, -5.0, 0.0])),
        },
    )
    write_transforms(plan.motions, tmp_path / "plan")
    assert sorted(p.name for p in (tmp_path / "plan").iterdir()) == ["lefort1.tfm", "mandible_distal.tfm"]
    text = (tmp_path / "plan/mandible_distal.tfm").read_text()
    assert "Transform: AffineTransform_double_3_3\nParameters: 1 0 0 0 1 0 0 0 1 0 5 0\nFixedParameters: 0 0 0" in text
    back = Plan.read(tmp_path / "plan", "P1")
    assert back.case == "P1" and set(back.motions) == set(plan.motions)
    for name, motion in plan.motions.items():
        np.testing.assert_allclose(back.motion(name).apply(POINTS), motion.apply(POINTS), atol=1e-9)


def test_other_files_of_the_folder_are_ignored_but_named(tmp_path, caplog):
    save(affine(), tmp_path)
    (tmp_path / ".DS_Store").write_bytes(b"x")
    (tmp_path / "scene.mrml").write_text("x")
    assert set(Plan.read(tmp_path, "P1").motions) == {"mandible"}
    assert "scene.mrml" in caplog.text and ".DS_Store" not in caplog.text


def write(text):
    return lambda folder: (folder / "mandible.tfm").write_text(text)


def several(suffix):
    return lambda folder: save(sitk.CompositeTransform([affine(), affine()]), folder, suffix)


def two_in_a_mat(folder):
    save(affine(), folder, "mat")
    file = folder / "mandible.mat"
    file.write_bytes(2 * file.read_bytes())


def not_finite(folder):
    transform = sitk.TranslationTransform(3, (0.0, float("nan"), 0.0))
    save(transform, folder, "mat")


def two_files(folder):
    save(affine(), folder)
    save(affine(), folder, "h5")


LONG = [1, 0, 0, 0, 1, 0, 0, 0, 1, 0, 500, 0]
NEARLY_STRAIGHT = [*Rotation.from_rotvec([1e-3, 0, 0], degrees=True).as_matrix().ravel(), 0, 5000, 0]


def _millions(folder):
    """A transform whose file says that it has ten thousand million parameters, none of which is there."""
    with h5py.File(folder / "mandible.h5", "w") as file:
        entry = file.create_group("TransformGroup/0")
        entry["TransformType"] = np.array([b"AffineTransform_double_3_3"])
        entry.create_dataset("TransformParameters", (10**10,), "f8", chunks=(1000,))


def _endless(folder):
    """A transform whose heap of texts has an entry of no length, at which HDF5 never gets on."""
    save(affine(), folder, "h5")
    content = bytearray((folder / "mandible.h5").read_bytes())
    heap = content.find(b"GCOL") + 16
    content[heap : heap + 16] = bytes(16)
    (folder / "mandible.h5").write_bytes(content)


BAD = {
    "scaling": (lambda d: save(sitk.ScaleTransform(3, (1.0, 1.0, 1.01)), d), "scales, shears or mirrors", "rigid"),
    "shear": (write(slicer_file([1, 0.1, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0])), "scales, shears or mirrors", "rigid"),
    "mirror": (write(slicer_file([-1, 0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0])), "scales, shears or mirrors", "rigid"),
    "warp": (lambda d: save(sitk.BSplineTransform(3), d), "not a linear transform", "linear"),
    "plane": (lambda d: save(sitk.Euler2DTransform(), d), "not a linear transform of space", "linear"),
    "composite": (several("h5"), "holds 2 transforms", "harden"),
    "composite text": (several("tfm"), "holds 2 transforms", "harden"),
    "two in a mat": (two_in_a_mat, "holds 2 transforms", "harden"),
    "nan": (not_finite, "not finite", "finite"),
    "metres": (write(slicer_file(LONG)), "by 500 mm", "millimetres"),
    "metres, hardly turned": (write(slicer_file(NEARLY_STRAIGHT)), "by 5000 mm", "millimetres"),
    "an h5 of millions": (_millions, "cannot be read as a transform.*10000000000 numbers", "again"),
    "an h5 without an end": (_endless, "reading it does not end", "again"),
    "two files": (two_files, "'mandible' has two transforms", "one file"),
    "empty": (lambda d: None, "holds no transform", "one per segment"),
}


@pytest.mark.parametrize("fault", BAD)
def test_a_bad_transform_is_refused_by_case_file_and_remedy(tmp_path, fault):
    make, problem, remedy = BAD[fault]
    folder = tmp_path / "mandible"
    folder.mkdir()
    make(folder)
    with pytest.raises(InputError, match=rf"(?s)case 'P1': .*mandible.*: .*{problem}.*Remedy: .*{remedy}"):
        Plan.read(folder, "P1")
