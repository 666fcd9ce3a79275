"""Plans as ITK or 3D Slicer transforms: a folder with one linear transform per segment.

An ITK file maps the points of the result to those of the input, because an image is resampled by asking for each new
voxel where it came from; 3D Slicer calls this "from parent" and writes it in LPS. A bone goes the other way, so its
motion is the inverse of the file. What Slicer shows in its Transforms module is the motion itself, in RAS: (0, 5, 0)
there moves the bone 5 mm forward and stands in the file as (0, 5, 0) in LPS, whose inverse (0, -5, 0) is 5 mm forward.
"""

import logging
import os
import re
import resource
import tempfile
from codecs import BOM_UTF8
from collections.abc import Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from multiprocessing import get_context
from pathlib import Path

import h5py
import numpy as np
import SimpleITK as sitk
from scipy.io import loadmat, whosmat

from pinnochio.errors import InputError, refusal
from pinnochio.files import entries, replacing
from pinnochio.geometry.rigid import LARGEST_TRANSLATION, NEARLY, RigidMotion, nearest_rotation
from pinnochio.plans.plan import TRANSFORM_FORMATS

LOG = logging.getLogger(__name__)
RIGID = 1e-4  # what files in single precision leave of R'R = I
NO_ROTATION = 1e-6
AGAIN = "save the linear transform again, with finite numbers"
FIXED, KEYS = "TransformFixedParameters", ("Transform", "Parameters", "FixedParameters")
NUMBER = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?", re.ASCII)
MOST = 1000  # numbers of a linear transform are 16 at most
SECONDS = 2  # of a processor; HDF5 reads some damaged files for ever, undamaged ones take milliseconds
LARGEST = 1e300  # a number beyond it is taken for infinite
# Parameters and fixed parameters of ITK's linear transforms of space, by the name without its types.
PARAMETERS = {
    **dict.fromkeys(("AffineTransform", "MatrixOffsetTransformBase"), ((12, 3),)),
    "Euler3DTransform": ((6, 3), (6, 4)),
    "VersorRigid3DTransform": ((6, 3),),
    "VersorTransform": ((3, 3),),
    "QuaternionRigidTransform": ((7, 3),),
    "Similarity3DTransform": ((7, 3),),
    "ScaleVersor3DTransform": ((9, 3),),
    "ScaleSkewVersor3DTransform": ((15, 3),),
    "Rigid3DTransform": ((12, 3),),
    "TranslationTransform": ((3, 0),),
    "ScaleTransform": ((3, 3),),
    "IdentityTransform": ((0, 0),),
}
FARTHEST_PIVOT = 1000.0  # mm; a head lies so near to the origin of its scanner


def read_transforms(folder: str | os.PathLike, case: str) -> dict[str, RigidMotion]:
    """Motion of each segment, from the files `{segment}.tfm`, `.txt`, `.h5` or `.mat` of a folder, or one; LPS, mm.

    Any transform of ITK that is rigid is taken, whatever its type and centre; composites of one as well. Raises
    InputError for what is not rigid, for several transforms in one file and for two files of one segment.
    """
    files: dict[str, Path] = {}
    for file in entries(folder) if Path(folder).is_dir() else [Path(folder)]:
        if file.suffix.lower() not in TRANSFORM_FORMATS:
            LOG.warning("case %r: %s is no transform; ignored", case, file)
        elif file.stem in files:
            raise InputError(case, file, f"segment {file.stem!r} has two transforms", "keep one file per segment")
        else:
            files[file.stem] = file
    if not files:
        remedy = f"save one per segment as {{segment}}{', '.join(TRANSFORM_FORMATS)}"
        raise InputError(case, folder, "the folder holds no transform", remedy)
    return {segment: _read_motion(file, case) for segment, file in files.items()}


def transforms_in(folder: str | os.PathLike) -> list[Path]:
    """The files of transforms in a folder, by name."""
    return [file for file in entries(folder) if file.suffix.lower() in TRANSFORM_FORMATS]


def write_transforms(motions: Mapping[str, RigidMotion], folder: str | os.PathLike) -> None:
    """Write `{segment}.tfm` for each motion, as 3D Slicer does: from parent, LPS, mm, an affine about the origin."""
    for segment, motion in motions.items():
        back = sitk.AffineTransform(3)
        back.SetMatrix(motion.rotation.T.ravel().tolist())
        back.SetTranslation(motion.inverse(np.zeros((1, 3)))[0].tolist())
        with replacing(Path(folder) / f"{segment}.tfm") as temporary:
            sitk.WriteTransform(back, str(temporary))


def _read_motion(file: Path, case: str) -> RigidMotion:
    motion = about_its_axis(*read_rigid(file, case))
    if not np.linalg.norm(motion.translation) <= LARGEST_TRANSLATION:
        problem = f"it moves the bone by {np.linalg.norm(motion.translation):.0f} mm"
        raise InputError(case, file, problem, f"save translations in millimetres ({LARGEST_TRANSLATION:.0f} at most)")
    return motion


def read_rigid(file: Path, case: str, source: Path | None = None) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Rotation (3, 3), offset (3,) and centre of a rigid ITK transform; its inverse is rotation (x - offset), LPS mm.

    InputError for a file (source: what it is a copy of) that is damaged, holds several transforms or one that is not
    rigid.
    """
    source, content = source or file, file.read_bytes()
    refuse = refusal(case, source)
    if file.suffix != file.suffix.lower() or content.startswith(BOM_UTF8):  # ITK goes by the ending, and reads no mark
        with tempfile.TemporaryDirectory() as folder:
            plain = Path(folder, f"plain{file.suffix.lower()}")
            plain.write_bytes(content.removeprefix(BOM_UTF8))
            return read_rigid(plain, case, source)
    if file.suffix.lower() in (".tfm", ".txt"):
        _check_text(file, lambda problem: refuse(f"it cannot be read as a transform ({problem})", AGAIN))
    try:
        stored = _parameters(file)
        for name, *numbers in stored:
            wanted = PARAMETERS.get(name.split("_")[0])
            if wanted is not None and tuple(map(len, numbers)) not in wanted:
                refuse(f"{name} has {len(numbers[0])} and {len(numbers[1])} parameters", AGAIN)
        transform, count = sitk.ReadTransform(str(file)), len(stored)
    except InputError:
        raise
    except Exception as error:  # ITK, HDF5 and MATLAB's format raise what they like
        reason = (str(error).strip() or type(error).__name__).splitlines()[-1]
        refuse(f"it cannot be read as a transform ({reason})", AGAIN)
    if transform.GetTransformEnum() == sitk.sitkComposite:
        count = sitk.CompositeTransform(transform).GetNumberOfTransforms()
    if count != 1:
        refuse(f"it holds {count} transforms", "harden them into one linear transform per segment")
    if transform.GetDimension() != 3 or not transform.IsLinear():
        refuse("it is not a linear transform of space", "save one rigid (linear) transform per segment")
    offset = np.array(transform.TransformPoint((0.0, 0.0, 0.0)))
    matrix = np.array([transform.TransformPoint(axis) for axis in np.eye(3).tolist()]).T - offset[:, None]
    if not np.isfinite([*matrix.ravel(), *offset]).all():
        refuse("it holds a number that is not finite", "write finite numbers")
    if not _as_stored(transform, *stored[-1][1:]):
        refuse("ITK takes its numbers for others, as of a quaternion longer than 1", AGAIN)
    rotation, off = nearest_rotation(matrix)
    if not off <= NEARLY:
        refuse("it scales, shears or mirrors", "save a rigid transform: rotation and translation only")
    if off > RIGID:
        LOG.warning("case %r: %s: its rotation is rounded (R'R differs from I by %.1g); made one", case, source, off)
    return rotation.T, offset, np.array(transform.GetFixedParameters()[:3])


def about_its_axis(rotation, offset, centre) -> RigidMotion:
    """x_post = rotation (x_pre - offset), with the pivot nearest to the axis of the screw that the motion is.

    The centre of a file is often the origin of the scanner, far from the bone, where the translation says nothing; on
    the axis it is the smallest that any pivot gives. The pivot lies within FARTHEST_PIVOT of the centre, so that a long
    translation with hardly any rotation is still seen as one; without rotation it is the centre.
    """
    centre = centre if len(centre) == 3 else np.zeros(3)
    shift = rotation @ (centre - offset) - centre
    turn = np.eye(3) - rotation
    if np.abs(turn).max() < NO_ROTATION:
        return RigidMotion(rotation, shift, centre)
    way = np.linalg.pinv(turn, rcond=NO_ROTATION) @ shift
    pivot = centre + way * min(1.0, FARTHEST_PIVOT / max(np.linalg.norm(way), 1e-12))
    return RigidMotion(rotation, rotation @ (pivot - offset) - pivot, pivot)


def _as_stored(transform: sitk.Transform, *stored) -> bool:
    """Whether a transform, alone or in a composite, has the parameters and fixed parameters that its file holds."""
    if transform.GetTransformEnum() == sitk.sitkComposite:
        transform = sitk.CompositeTransform(transform).GetNthTransform(0)
    read = transform.GetParameters(), transform.GetFixedParameters()
    return all(
        np.allclose(one[: len(other)], other[: len(one)], rtol=1e-5, atol=1e-8)
        for one, other in zip(read, stored, strict=True)
    )


def _few(numbers: h5py.Dataset) -> np.ndarray:
    """What a transform holds; ValueError where a damaged file says that it is millions, too long to read."""
    if numbers.size > MOST:
        raise ValueError(f"{numbers.name} holds {numbers.size} numbers")
    return np.ravel(numbers[()])


def _of_hdf5(file: Path) -> list[tuple[str, Sequence[float], Sequence[float]]]:
    """The same of a file of HDF5; ITK, which reads it by itself, tries it too."""
    with h5py.File(file) as content:
        stored = [
            (
                _few(entry["TransformType"])[0].decode(),
                *(_few(entry[key]) if key in entry else () for key in ("TransformParameters", FIXED)),
            )
            for entry in content["TransformGroup"].values()
        ]
    sitk.ReadTransform(str(file))
    return stored


def _parameters(file: Path) -> list[tuple[str, Sequence[float], Sequence[float]]]:
    """Name, parameters and fixed parameters of each transform in the file.

    ITK takes the first of several, and reads what is not there from memory that is not the file's.
    """
    suffix = file.suffix.lower()
    if suffix == ".h5":
        limit = (resource.RLIMIT_CPU, (SECONDS, SECONDS))
        with ProcessPoolExecutor(1, get_context("fork"), resource.setrlimit, limit) as aside:
            try:
                return aside.submit(_of_hdf5, file).result()
            except BrokenProcessPool:
                raise ValueError("it is damaged, and reading it does not end") from None
    if suffix == ".mat":
        matrices, names = loadmat(file), [name for name, *_ in whosmat(file) if name != "fixed"]
        return [(name, np.ravel(matrices[name]), np.ravel(matrices.get("fixed", ()))) for name in names]
    transforms = []
    for line in _lines(file):
        key, _, rest = line.partition(":")
        if key == "Transform":
            transforms.append((rest.strip(), {}))
        elif transforms:
            transforms[-1][1][key] = [float(word) for word in rest.split()]
    return [(name, values.get("Parameters", ()), values.get("FixedParameters", ())) for name, values in transforms]


def _lines(file: Path) -> list[str]:
    lines = [line.strip() for line in file.read_text(encoding="utf-8").split("\n")]
    return [line for line in lines if line and not line.startswith("#")]


def _check_text(file: Path, refuse) -> None:
    """Refuse a text file of another form than ITK writes: cut off, or with a number that ITK would read half."""
    try:
        text = file.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        refuse(f"it is no text ({error})")
    if not text.startswith("#Insight Transform File"):
        refuse("it is no ITK transform: its first line is not '#Insight Transform File V1.0'")
    if not text.endswith("\n"):
        refuse("its last line does not end, so it may be cut off")
    for line in _lines(file):
        key, colon, rest = line.partition(":")
        # What is a blank to Python and none to ITK makes it read memory that is not the file's.
        if not colon or key not in KEYS or not (line.isascii() and line.replace("\t", " ").isprintable()):
            refuse(f"it has the line {line[:60]!r}")
        if key != "Transform" and (
            wrong := [word for word in rest.split() if not NUMBER.fullmatch(word) or abs(float(word)) > LARGEST]
        ):
            refuse(f"{wrong[0]!r} is no finite number with a decimal point")
