"""Volumes read from exactly the file that is named, and whole: ITK fills what is cut off with zeros.

Compressed files carry a checksum of their content, and every header says how much there must be. ITK looks at neither,
and it reads `x.nii` where `x.nii.gz` is named and both are there.
"""

import gzip
import math
import os
import re
import struct
import tempfile
import zlib
from pathlib import Path

import numpy as np
import SimpleITK as sitk
from scipy.spatial.transform import Rotation

from pinnochio.errors import REMEDY, Refuse, refusal
from pinnochio.importing.dicom_series import read_series
from pinnochio.volume_size import IMAGE_FORMATS

GZIP = b"\x1f\x8b"
AGAIN = "export it again, or copy it again from where it comes from"
FRAMELESS = "frameless"  # metadata of an image whose header holds no frame: what it lacks
TURNED = 1e-2  # cosines by which the two frames of a NIfTI header may differ
APART = 0.5  # mm; so may their origins
STRETCHED = 1e-2  # share by which voxel size and frame may differ
# Bytes of an element by the words of NRRD and of MetaImage.
_C = {"char": 1, "short": 2, "short int": 2, "int": 4, "longlong": 8, "long long": 8, "long long int": 8}
NRRD_BYTES = {sign + word: size for sign in ("", "signed ", "unsigned ", "u") for word, size in _C.items()}
NRRD_BYTES |= {f"{sign}int{8 * size}{end}": size for size in (1, 2, 4, 8) for sign in ("", "u") for end in ("", "_t")}
NRRD_BYTES |= {"float": 4, "double": 8}
# Bits of a voxel by the data type of NIfTI: whole numbers, then others.
NIFTI_BITS = {2: 8, 256: 8, 4: 16, 512: 16, 8: 32, 768: 32, 1024: 64, 1280: 64}
NIFTI_BITS |= {1: 1, 16: 32, 64: 64, 32: 64, 1792: 128, 1536: 128, 2048: 256, 128: 24, 2304: 32}
# Numbers of each key of MetaImage by the count of axes, what stands for a key that is not there, and its other names.
META_NUMBERS = {
    "TransformMatrix": (lambda axes: axes * axes, lambda axes: np.eye(axes).ravel(), "Rotation", "Orientation"),
    "Offset": (lambda axes: axes, np.zeros, "Position", "Origin"),
    "ElementSpacing": (lambda axes: axes, lambda axes: (), "ElementSize"),
}
GIPL_HEADER, GIPL_BYTES = 256, {7: 1, 8: 1, 15: 2, 16: 2, 31: 4, 32: 4, 64: 4, 65: 8}
META_BYTES = {"CHAR": 1, "SHORT": 2, "INT": 4, "LONG_LONG": 8, "FLOAT": 4, "DOUBLE": 8}


def read_volume(path: str | os.PathLike, refuse: Refuse, pixel: int = sitk.sitkUnknown, layers: bool = False):
    """:func:`read_image` of one volume of one channel (layers: or of several, one for each layer of segments); a series
    of DICOM, by its folder, too."""
    if not os.path.exists(path):
        refuse("the file does not exist", "correct its path")
    if os.path.isdir(path) or str(path).lower().endswith(".dcm"):
        image = read_series(path, refuse)
    elif str(path).lower().endswith(IMAGE_FORMATS):
        image = read_image(path, refuse, pixel)
    else:
        refuse("this is no image format known here", f"save it as one of {', '.join(IMAGE_FORMATS)}")
    if image.GetDimension() == 4 and image.GetSize()[3] == 1:
        whole, image = image, image[..., 0]
        for key in {FRAMELESS}.intersection(whole.GetMetaDataKeys()):
            image.SetMetaData(key, whole.GetMetaData(key))
    channels = image.GetNumberOfComponentsPerPixel()
    layered = layers and image.HasMetaDataKey("Segment0_ID")
    if image.GetDimension() != 3 or (channels != 1 and not layered) or min(image.GetSize()) < 2:
        size = "x".join(map(str, image.GetSize()))
        refuse(f"it is {size} with {channels} channel(s), not a volume", "save one volume with one channel")
    return image


def face(image: sitk.Image, direction: np.ndarray | None, refuse: Refuse) -> None:
    """Give an image with a wrong header, or with none, these axes (3, 3) in LPS; its origin turns with them.

    None: its header is right; one that holds no frame is refused, because it may be mirrored.
    """
    if direction is None and image.HasMetaDataKey(FRAMELESS):
        problem = f"its header holds no frame ({image.GetMetaData(FRAMELESS)}): it may be mirrored"
        refuse(problem, "export it with its frame, or set 'orientation' to where its voxel axes point")
    if direction is not None:
        stated = np.reshape(image.GetDirection(), (3, 3))
        image.SetOrigin(tuple(direction @ np.linalg.inv(stated) @ image.GetOrigin()))
        image.SetDirection(direction.ravel().tolist())


def read_image(path: str | os.PathLike, refuse: Refuse, pixel: int = sitk.sitkUnknown) -> sitk.Image:
    """The volume of a NIfTI, NRRD, MetaImage or GIPL file, if all of it is there; else refuse(problem, remedy).

    pixel: the type of SimpleITK that its voxels are turned into.
    """
    if not os.path.isfile(path):
        refuse("it is not there, or is a folder", "correct its path")
    if not os.path.getsize(path):
        refuse("it is empty", AGAIN)
    name, content, framed = str(path).lower(), Path(path).read_bytes(), True
    if name.endswith((".nii", ".nii.gz")):  # compressed or not, by its content
        content = _unpacked(content, refuse)
        framed = _check_nifti(content, refuse)
        image = _read_whole(_first_nifti(content), "image.nii", refuse, pixel)
    elif name.endswith((".nrrd", ".nhdr")):
        content = _attached(Path(path), refuse) if name.endswith(".nhdr") else content
        framed = _check_nrrd(content, refuse)
        image = _read_whole(content, "image.nrrd", refuse, pixel)
    elif name.endswith((".mha", ".mhd")):
        image = _read_whole(_plain_meta(Path(path), content, refuse), "image.mha", refuse, pixel)
    else:
        content = _unpacked(content, refuse)
        _check_gipl(content, refuse)
        image = _read_whole(content, "image.gipl", refuse, pixel)
    if not framed:
        image.SetMetaData(FRAMELESS, "qform_code and sform_code are 0" if ".nii" in name else "it names no space")
    return image


def read_stored_image(path: str | os.PathLike) -> sitk.Image:
    """A volume that the study itself has written; InputError where it is damaged."""
    return read_image(path, refusal("-", path, REMEDY))


def _read_whole(content: bytes, name: str, refuse: Refuse, pixel: int) -> sitk.Image:
    """The volume of a file of this name with this content."""
    with tempfile.TemporaryDirectory() as folder:
        plain = Path(folder, name)
        plain.write_bytes(content)
        return _read(plain, refuse, pixel)


def _read(path, refuse: Refuse, pixel: int) -> sitk.Image:
    try:
        image = sitk.ReadImage(str(path), pixel)
    except RuntimeError as error:
        reason = str(error).strip().splitlines()[-1]
        refuse(f"it cannot be read as an image ({reason})", "export the label map again")
    spacing = image.GetSpacing()
    check_places([*spacing, *image.GetOrigin(), *image.GetDirection()], spacing, refuse)
    return image


def check_places(places, spacing, refuse: Refuse) -> None:
    """Refuse a grid whose voxel size, origin or axes, all `places`, are none."""
    if not np.isfinite(places).all() or not np.abs(places).max() <= 1e6 or not min(spacing) >= 1e-6:
        refuse("its header holds no proper voxel size, origin and axes", "correct the header, or export it again")


def _unpacked(content: bytes, refuse: Refuse) -> bytes:
    """What a gzip file holds, by its checksum; anything else as it stands."""
    if not content.startswith(GZIP):
        return content
    try:
        return gzip.decompress(content)
    except (EOFError, gzip.BadGzipFile, zlib.error, struct.error) as error:
        refuse(f"it is damaged or cut off ({error})", AGAIN)


def _check_size(word: object, refuse: Refuse) -> None:
    """Refuse a size of voxels that is no number above 0; ITK turns the axis of a negative one round."""
    try:
        proper = 0 < float(word) < math.inf
    except ValueError:
        proper = False
    if not proper:
        refuse(f"its header holds {word} as the size of a voxel", "correct the header, or export it again")


def _check_length(there: int, wanted: int, refuse: Refuse) -> None:
    if there != wanted:
        refuse(f"its header asks for {wanted} bytes of voxels, and {there} are there", AGAIN)


def _check_nifti(content: bytes, refuse: Refuse) -> bool:
    """Whether a header holds a frame; refused where it contradicts itself or the length of the file."""
    first = {order: struct.unpack(order + "i", content[:4])[0] if len(content) > 3 else 0 for order in "<>"}
    order = next((order for order, size in first.items() if size in (348, 540)), None)
    if order is None or len(content) < first[order]:
        refuse("it is no NIfTI file, or its header is cut off", AGAIN)
    old = first[order] == 348

    def numbers(kind: str, count: int, at: int, new_at: int, new_kind: str = "") -> tuple:
        return struct.unpack_from(f"{order}{count}{kind if old else new_kind or kind}", content, at if old else new_at)

    if content[344:348] != b"n+1\0" if old else content[4:8] != b"n+2\0":
        refuse("it is no single NIfTI file (its mark is wrong)", "save header and voxels in one .nii or .nii.gz")
    sides = numbers("h", 8, 40, 16, "q")
    if not 1 <= sides[0] <= 7 or min(sides[1 : sides[0] + 1]) < 1:
        refuse(f"its header gives the sizes {sides[1:]} of {sides[0]} axes", AGAIN)
    (kind,), (bits,) = numbers("h", 1, 70, 12), numbers("h", 1, 72, 14)
    (start,) = numbers("f", 1, 108, 168, "q")
    if not first[order] <= start <= len(content) or bits < 1:
        refuse(f"its header has voxels of {bits} bits begin at byte {start:g}", AGAIN)
    if bits != NIFTI_BITS.get(kind):
        refuse(f"its header has voxels of type {kind} and {bits} bits, which is none", AGAIN)
    wanted = (math.prod(int(side) for side in sides[1 : sides[0] + 1]) * bits + 7) // 8
    _check_length(len(content) - int(start), wanted, refuse)
    if kind in (16, 64):  # ITK turns NaN into 0 without a word
        voxels = np.frombuffer(content, f"{order}f{bits // 8}", offset=int(start))
        if not np.isfinite(voxels).all():
            refuse("it holds NaN or infinite voxels", "replace them by 0 (air)")
    steps = np.array(numbers("f", 8, 76, 104, "d"), float)
    by_quaternion, by_rows = numbers("h", 2, 252, 344, "i")
    quaternion = np.array(numbers("f", 6, 256, 352, "d"), float)
    rows = np.reshape(numbers("f", 12, 280, 400, "d"), (3, 4)).astype(float)
    used = [steps[1:4], *([quaternion] if by_quaternion > 0 else []), *([rows] if by_rows > 0 else [])]
    if not all(np.isfinite(part).all() for part in used) or not (steps[1 : min(sides[0], 3) + 1] > 0).all():
        refuse("its header holds voxel sizes or axes that are not finite numbers above 0", "correct the header")
    if by_quaternion > 0 and not np.linalg.norm(quaternion[:3]) <= 1 + TURNED:
        refuse("its header holds a quaternion (qform) that is no rotation", "correct the header, or export it again")
    scale = np.array(numbers("f", 2, 112, 176, "d"), float)
    if not np.isfinite(scale).all():
        refuse("its header scales the voxels by a number that is not finite", "save it without scaling")
    if by_rows > 0 and sides[0] >= 3:
        lengths = np.linalg.norm(rows[:, :3], axis=0)
        if (np.abs(lengths - steps[1:4]) > STRETCHED * steps[1:4]).any():
            shown = " x ".join(f"{value:g}" for value in steps[1:4]), " x ".join(f"{value:.4g}" for value in lengths)
            refuse(f"its header gives voxels of {shown[0]} and axes for {shown[1]} mm", "write one of them into both")
        if by_quaternion > 0:
            other = _turned(quaternion[:3], -1.0 if steps[0] < 0 else 1.0)
            if (
                np.abs(rows[:, :3] / lengths - other).max() > TURNED
                or np.abs(rows[:, 3] - quaternion[3:]).max() > APART
            ):
                refuse("its header holds two frames that differ (qform and sform)", "export it with one frame")
    return by_quaternion > 0 or by_rows > 0


def _first_nifti(content: bytes) -> bytes:
    """A NIfTI file of the second version as one of the first, which ITK reads; another one as it stands."""
    order = next(order for order in "<>" if struct.unpack(order + "i", content[:4])[0] in (348, 540))
    if struct.unpack(order + "i", content[:4])[0] == 348:
        return content

    def at(kind: str, place: int) -> tuple:
        return struct.unpack_from(order + kind, content, place)

    sides, (start,), (units,) = at("8q", 16), at("q", 168), at("i", 500)
    head = bytearray(352)
    for place, kind, values in (
        (0, "i", (348,)),
        (40, "8h", [min(side, 2**15 - 1) for side in sides]),
        (70, "2h", at("2h", 12)),  # type and bits
        (76, "8f", at("8d", 104)),  # voxel sizes
        (108, "3f", (352.0, *at("2d", 176))),  # start and scale
        (123, "b", (units & 127,)),
        (252, "2h", at("2i", 344)),  # which frames there are
        (256, "6f", at("6d", 352)),
        (280, "12f", at("12d", 400)),
    ):
        struct.pack_into(order + kind, head, place, *values)
    head[344:348] = b"n+1\0"
    return bytes(head) + content[start:]


def _turned(vector, handed: float) -> np.ndarray:
    """Rotation (3, 3) of the quaternion whose last three numbers NIfTI stores, its third axis turned by `handed`."""
    scalar = math.sqrt(max(0.0, 1 - vector @ vector))
    return Rotation.from_quat([*vector, scalar]).as_matrix() * [1, 1, handed]


def _check_gipl(content: bytes, refuse: Refuse) -> None:
    """Refuse a GIPL file, unpacked, whose voxels are not as many as its header says."""
    if len(content) < GIPL_HEADER:
        refuse("it is no GIPL file, or its header is cut off", AGAIN)
    *sides, kind = struct.unpack(">5H", content[:10])
    if kind not in GIPL_BYTES:
        refuse(f"its voxels are of type {kind}, not of numbers of 1, 2, 4 or 8 bytes", "save it as .nii.gz")
    for size in struct.unpack(">3f", content[10:22]):
        _check_size(size, refuse)
    wanted = math.prod(max(side, 1) for side in sides) * GIPL_BYTES[kind]
    _check_length(len(content) - GIPL_HEADER, wanted, refuse)


def _attached(path: Path, refuse: Refuse) -> bytes:
    """The NRRD file that a header alone and the one file of voxels beside it make."""
    head, _, _ = path.read_bytes().replace(b"\r\n", b"\n").partition(b"\n\n")
    line = re.search(rb"^data ?file:[ \t]*([^/\\\0%\n]{1,200})$", head, re.MULTILINE)
    beside = path.parent / os.fsdecode(line[1].strip()) if line else None
    if beside is None or not beside.is_file():
        refuse("the file with its voxels is not there", "put it beside the .nhdr, or save one .nrrd")
    return head.replace(line[0], b"# attached").rstrip(b"\n") + b"\n\n" + beside.read_bytes()


def _check_nrrd(content: bytes, refuse: Refuse) -> bool:
    """Whether a NRRD file names its space; refused where its voxels are not as many as it says, or elsewhere."""
    end = re.search(rb"\r?\n\r?\n", content)
    if not content.startswith(b"NRRD") or end is None:
        refuse("it is no NRRD file, or its header is cut off", AGAIN)
    lines = [line.strip() for line in content[: end.start()].decode("utf-8", "replace").splitlines()[1:]]
    said = dict(line.split(": ", 1) for line in lines if ": " in line and ":=" not in line and line[:1] != "#")
    said = {key.strip().lower(): value.strip() for key, value in said.items()}
    if "data file" in said or "datafile" in said:
        refuse("its voxels lie in another file", "save it as one .nrrd")
    data = content[end.end() :]
    if not set(said.get("space units", "").replace('"', "").split()) <= {"mm"}:
        refuse(f"its unit is {said['space units']}", "save it in millimetres")
    for word in said.get("spacings", "").split():  # ITK takes NaN for 1 mm
        _check_size(word, refuse)
    try:
        sides = [int(word) for word in said["sizes"].split()]
        if len(sides) != int(said["dimension"]) or not 2 <= len(sides) <= 4 or min(sides) < 1:
            raise ValueError(f"{len(sides)} sizes, {said['dimension']} axes")
        wanted = math.prod(sides) * NRRD_BYTES[said["type"].lower()] + int(said.get("byte skip", 0))
    except (KeyError, ValueError) as error:
        refuse(f"its header says nothing known of 'type' and 'sizes' ({error})", "save it again as .nrrd")
    encoding = said.get("encoding", "raw").lower()
    if encoding in ("gzip", "gz"):
        data = _unpacked(data, refuse)
    elif encoding not in ("raw",):
        refuse(f"its voxels are encoded as {encoding!r}", "save it as raw or gzip")
    _check_length(len(data), wanted, refuse)
    return "space" in said


def _plain_meta(path: Path, content: bytes, refuse: Refuse) -> bytes:
    """A MetaImage of what is checked of one, its content: ITK ends the process where a word of its header is damaged.

    Its voxels must be as many as it says, and lie in the file itself or, of a `.mhd`, in one beside it.
    """
    marker = re.search(rb"^ElementDataFile *= *(.*?)\r?(\n|\Z)", content, re.MULTILINE)
    if marker is None:
        refuse("it is no MetaImage, or its header is cut off", AGAIN)
    lines = content[: marker.start()].decode("ascii", "replace").splitlines()
    pairs = [line.partition("=") for line in lines if "=" in line]
    said = {key.strip(): value.strip() for key, _, value in pairs}
    if len(said) < len(pairs):
        refuse("a key of its header stands twice", "save it again as .mha")
    where, data = marker[1].strip(), content[marker.end() :]
    if where.upper() != b"LOCAL":
        beside = path.parent / os.fsdecode(where) if re.fullmatch(rb"[^/\\\0%]{1,200}", where) else None
        if path.suffix.lower() != ".mhd" or beside is None or not beside.is_file():
            refuse("its voxels lie in another file", "save it as one .mha, or put that file beside the .mhd")
        data = beside.read_bytes()

    def one_of(*keys: str) -> str:
        return next((said[key] for key in keys if key in said), "nothing")

    try:
        element = said["ElementType"].removeprefix("MET_").removesuffix("_ARRAY")
        sides, channels = [int(word) for word in said["DimSize"].split()], int(said.get("ElementNumberOfChannels", 1))
        axes, order = len(sides), one_of("BinaryDataByteOrderMSB", "ElementByteOrderMSB").lower()
        if axes != int(said["NDims"]) or not 2 <= axes <= 4 or min(sides) < 1 or not 0 < channels < 1000:
            raise ValueError(f"{axes} sizes, {said['NDims']} axes")
        if one_of("BinaryData").lower() != "true" or order not in ("true", "false"):
            raise ValueError("no BinaryData, or no byte order")
        wanted = math.prod(sides) * channels * META_BYTES[element.removeprefix("U")]
        plain = {"ObjectType": "Image", "NDims": axes, "BinaryData": "True", "BinaryDataByteOrderMSB": order.title()}
        plain |= {"CompressedData": "False", "ElementNumberOfChannels": channels}
        skipped = int(said.get("HeaderSize", 0))
        data = data[-wanted if skipped == -1 else skipped :]
        for key, (count, usual, *names) in META_NUMBERS.items():
            there = sum(name in said for name in (key, *names))
            if there > 1:
                raise ValueError(f"{key} twice")
            if not there and said.get("AnatomicalOrientation", "RAI") in ("RAI", "???"):
                said[key] = " ".join(map(str, usual(axes)))
            numbers = [float(word.replace("_", "?")) for word in one_of(key, *names).split()]  # Python reads 3_0 as 30
            if len(numbers) != count(axes) or not np.isfinite(numbers).all():
                raise ValueError(f"{key} of {len(numbers)} numbers")
            plain[key] = " ".join(map(repr, numbers))
        for size in plain["ElementSpacing"].split():
            _check_size(size, refuse)
    except (KeyError, ValueError) as error:
        refuse(f"its header lacks a word or a number, or one is damaged ({error})", "save it again as .mha")
    if one_of("CompressedData").lower() == "true":
        try:
            data = zlib.decompress(data)
        except zlib.error as error:
            refuse(f"it is damaged or cut off ({error})", AGAIN)
    _check_length(len(data), wanted, refuse)
    plain |= {"DimSize": " ".join(map(str, sides)), "ElementType": said["ElementType"].removesuffix("_ARRAY")}
    plain["ElementDataFile"] = "LOCAL"
    return "".join(f"{key} = {value}\n" for key, value in plain.items()).encode() + data
