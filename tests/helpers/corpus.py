"""Damaged, extreme and merely unusual inputs of every kind, made from a seed."""

import io
import json
import re
import zlib
from collections.abc import Callable, Iterator
from dataclasses import asdict, fields
from functools import cache, partial
from pathlib import Path

import numpy as np
import pandas as pd
import pydicom
import SimpleITK as sitk
import torch

from pinnochio.columns import read_table, write_csv
from pinnochio.importing.cohort import read_cases
from pinnochio.importing.images import read_stored_image
from pinnochio.importing.markups import read_markups
from pinnochio.importing.segmentation import read_postop, read_segmentation, write_segmentation
from pinnochio.json_text import read_stored_json
from pinnochio.mechanics.lift import Lift
from pinnochio.meshing.mesh import TetMesh
from pinnochio.metrics.case_columns import CASES
from pinnochio.metrics.model_quality import quality
from pinnochio.model.labels import internal_codes
from pinnochio.model.patient import PatientModel
from pinnochio.model.postop import PostopSkin
from pinnochio.model.predictions import Prediction, read_external, read_prediction, write_predictions
from pinnochio.model.surfaces import BoneSurface, bone_surface, read_surface, skin_surface, write_surface
from pinnochio.model.truth import read_truth
from pinnochio.networks.building import build
from pinnochio.networks.settings import NetworkSettings
from pinnochio.patients.model_archive import Archive
from pinnochio.plans.plan import Plan
from pinnochio.plans.transforms import read_transforms
from pinnochio.statistics.intervals import Interval
from pinnochio.study.configuration import check_config
from pinnochio.study.schema import checked, read_schema
from pinnochio.tables.quality import tabulate
from pinnochio.tables.stages import read_benchmark
from pinnochio.training.checkpoint import read_network, save_network
from pinnochio.virtual.covariates import Covariates
from pinnochio.virtual.outcome import Outcome
from tests.helpers.dicom import save_dicom_seg
from tests.helpers.doors import doors
from tests.helpers.heads import kuhn_cube
from tests.helpers.judging import Tried
from tests.helpers.patients import tiny_patient, tiny_plan
from tests.helpers.rows import benchmark, row
from tests.helpers.settings import CONFIG, ROOT, network_settings
from tests.helpers.tools import write_seg_nrrd

SEGMENTS = ("lefort1", "mandible")
CODES = internal_codes(SEGMENTS)
SCHEMA = read_schema(ROOT)


def damaged(content: bytes, rng: np.random.Generator, count: int) -> Iterator[tuple[str, bytes]]:
    """The content cut off, with a bit turned, with a stretch of zeros, twice; and whole, which is right."""
    yield "whole", content
    size = len(content)
    for _ in range(count):
        at = int(rng.integers(0, size))
        yield f"cut at {at}", content[:at]
        near = int(rng.integers(1, min(size, 60)))
        yield f"cut {near} before the end", content[: size - near]
        turned = bytearray(content)
        turned[at] ^= 1 << int(rng.integers(0, 8))
        yield f"bit turned at {at}", bytes(turned)
        early = int(rng.integers(0, min(size, 400)))
        turned = bytearray(content)
        turned[early] ^= 1 << int(rng.integers(0, 8))
        yield f"bit turned at {early}, early", bytes(turned)
        length = int(rng.integers(4, 64))
        yield f"zeros at {at}", content[:at] + bytes(min(length, size - at)) + content[at + length :]
    yield "empty", b""
    yield "rubbish", rng.bytes(300)
    yield "twice", content + content


def of_bytes(
    kind: str, name: str, content: bytes, read: Callable[[Path], object], rng, count: int, sealed: float = 0
) -> Iterator[Tried]:
    """Damages of a file: refused, or read as the whole file is; sealed: byte from which a checksum notices a bit."""

    def act(data: bytes, folder: Path):
        (folder / name).write_bytes(data)
        return read(folder / name)

    right = once(partial(act, content))
    known = set()
    for what, data in damaged(content, rng, count):
        if f"{kind}: {name}: {what}" in known:
            continue
        known.add(f"{kind}: {name}: {what}")
        place = re.search(r"^(?:bit turned|zeros) at (\d+)", what)
        seen = not place or int(place[1]) >= sealed
        yield Tried(f"{kind}: {name}: {what}", partial(act, data), right if seen else ...)


def once(act: Callable[[Path], object]):
    """What the act gives in a folder of its own."""
    import tempfile

    with tempfile.TemporaryDirectory() as folder:
        return act(Path(folder))


def written(write: Callable[[Path], object], name: str) -> bytes:
    """The bytes of a file of this name that `write` makes."""

    def act(folder: Path) -> bytes:
        write(folder / name)
        return (folder / name).read_bytes()

    return once(act)


# ---- labels


def head() -> np.ndarray:
    labels = np.zeros((30, 32, 34), np.uint8)
    labels[3:27, 3:29, 3:31] = CODES["superficial"]
    labels[6:24, 6:26, 6:28] = CODES["muscle"]
    for name, low in (("cranium", 22), ("lefort1", 15), ("mandible", 8)):
        labels[8:22, 8:24, low : low + 5] = CODES[name]
    labels[8, 8, 8] = CODES["muscle"]
    return labels


def save_labels(path: Path, compressed: bool = True, kind: str = "uint8") -> None:
    image = sitk.GetImageFromArray(head().astype(kind).transpose(2, 1, 0))
    image.SetSpacing((4.0, 4.0, 4.0))
    image.SetOrigin((-60.0, -64.0, -70.0))
    sitk.WriteImage(image, str(path), useCompression=compressed)


def read_labels(path: Path):
    made = read_segmentation(path, "P1", CODES, SEGMENTS)
    return made.labels, made.spacing, made.origin, made.segments


def labels(rng: np.random.Generator, count: int) -> Iterator[Tried]:
    for name in ("a.nii.gz", "a.nii", "a.nrrd", "a.mha", "a.gipl.gz"):
        compressed = name != "a.nii"
        content = written(partial(save_labels, compressed=compressed), name)
        plain = {"a.nii": np.inf, "a.nrrd": content.find(b"\n\n"), "a.mha": content.find(b"LOCAL\n")}.get(name, 0)
        yield from of_bytes("labels", name, content, read_labels, rng, count, sealed=plain)
    right = once(lambda folder: (save_labels(folder / "a.nii.gz"), read_labels(folder / "a.nii.gz"))[1])

    def beside(folder: Path):
        """`a.nii` beside the file that is named: another head."""
        save_labels(folder / "a.nii.gz")
        image = sitk.GetImageFromArray(head().transpose(2, 1, 0)[:, :, ::-1] * 0 + 1)
        sitk.WriteImage(image, str(folder / "a.nii"))
        return read_labels(folder / "a.nii.gz")

    yield Tried("labels: another file beside it", beside, right)

    def with_header(at: int, value: bytes, folder: Path):
        content = bytearray(written(partial(save_labels, compressed=False), "a.nii"))
        content[at : at + len(value)] = value
        (folder / "a.nii").write_bytes(bytes(content))
        return read_labels(folder / "a.nii")

    for name, at, value in (
        ("NaN spacing", 80, np.float32(np.nan)),
        ("negative spacing", 80, np.float32(-4)),
        ("no spacing", 84, np.float32(0)),
        ("huge spacing", 88, np.float32(1e30)),
        ("another size", 42, np.int16(29)),
        ("no axes", 40, np.int16(0)),
        ("another frame", 268, np.float32(500)),
        ("NaN frame", 280, np.float32(np.nan)),
        ("NaN scale", 112, np.float32(np.nan)),
        ("far voxels", 108, np.float32(1e9)),
        ("no bits", 72, np.int16(0)),
        ("floats of 8 bits", 70, np.int16(16)),
        ("whole numbers of 8 of 16 bits", 70, np.int16(4)),
        ("no such type", 70, np.int16(9999)),
    ):
        yield Tried(f"labels: header with {name}", partial(with_header, at, value.tobytes()))
    no_rotation = np.array([1, 0], np.int16).tobytes() + np.ones(3, np.float32).tobytes()
    yield Tried("labels: header with a quaternion longer than 1", partial(with_header, 252, no_rotation))

    def as_a_folder(folder: Path):
        (folder / "a.nii.gz").mkdir()
        return read_stored_image(folder / "a.nii.gz")

    yield Tried("labels: a folder of that name", as_a_folder)

    def of_type(kind: str, folder: Path):
        save_labels(folder / "a.nrrd", kind=kind)
        return read_labels(folder / "a.nrrd")

    yield from overlapping()
    for kind in ("int8", "uint16", "int32", "uint32", "int64", "uint64", "float32", "float64"):
        yield Tried(f"labels: NRRD of {kind}", partial(of_type, kind), right)


def overlapping() -> Iterator[Tried]:
    """A skin that fills the head, bones over it, what `labels` does not name or leaves out; as surfaces, too."""
    made, grid = head(), (np.eye(3), np.full(3, 4.0), np.array([-60.0, -64.0, -70.0]))
    teeth, airway = np.zeros(made.shape, bool), np.zeros(made.shape, bool)
    teeth[8:22, 8:14, 15:20] = True
    airway[8:22, 3:6, 15:27] = True
    wanted = {name: name for name in CODES}

    def read(folder: Path, *, extra=(), left_out=(), renamed=(), values=None):
        masks = {name: made == code for name, code in CODES.items()} | dict(extra)
        masks["superficial"] = made > 0
        for name, mask in extra:
            masks = {key: kept & ~mask if name == "teeth" and key == "lefort1" else kept for key, kept in masks.items()}
        masks = {dict(renamed).get(name, name): mask for name, mask in masks.items()}
        segments = [(name, 1, layer) for layer, name in enumerate(masks)]
        write_seg_nrrd(folder / "a.seg.nrrd", list(masks.values()), segments, *grid)
        labels = wanted | (values or {}) | {"left_out": list(left_out)}
        return read_segmentation(folder / "a.seg.nrrd", "P1", labels, SEGMENTS, unnamed_percent=5.0).labels

    right = once(read)
    yield Tried("overlapping: as it should be", read, right)
    for name, mask in (("teeth", teeth), ("airway", airway)):
        yield Tried(f"overlapping: {name} that nothing names", partial(read, extra=[(name, mask)]))
    left = np.where(airway & (right < CODES["cranium"]), 0, right)
    yield Tried("overlapping: an airway left out", partial(read, extra=[("airway", airway)], left_out=["airway"]), left)
    yield Tried("overlapping: a name in other letters", partial(read, renamed=[("lefort1", "LeFort1")]))
    exchanged = {"lefort1": "mandible", "mandible": "lefort1"}
    yield Tried("overlapping: the name of another", partial(read, values=exchanged))

    def surfaces(folder: Path, *, renamed=()):
        (folder / "s").mkdir()
        for name, code in CODES.items():
            mask = made > 0 if name == "superficial" else made == code
            points, faces = skin_surface(mask.astype(np.uint8), np.full(3, 4.0), np.zeros(3))
            write_surface(points, faces, folder / f"s/{dict(renamed).get(name, name)}.stl")
        return read_segmentation(folder / "s", "P1", CODES, SEGMENTS, unnamed_percent=5.0).segments

    yield Tried("overlapping: surfaces", surfaces, SEGMENTS)
    for name in ("LeFort1", "Oberkiefer"):
        yield Tried(f"overlapping: a surface called {name}", partial(surfaces, renamed=[("lefort1", name)]))


def headers(rng: np.random.Generator, count: int) -> Iterator[Tried]:
    """Headers of MetaImage, NRRD and GIPL that say something else than what the voxels are."""
    voxels = head().transpose(2, 1, 0).tobytes()
    meta = {
        **{"ObjectType": "Image", "NDims": "3", "BinaryData": "True", "BinaryDataByteOrderMSB": "False"},
        **{"CompressedData": "False", "TransformMatrix": "1 0 0 0 1 0 0 0 1", "Offset": "-60 -64 -70"},
        **{"ElementSpacing": "4 4 4", "DimSize": "30 32 34", "ElementType": "MET_UCHAR"},
    }
    nrrd = {
        **{"type": "unsigned char", "dimension": "3", "space": "left-posterior-superior", "sizes": "30 32 34"},
        **{"space directions": "(4,0,0) (0,4,0) (0,0,4)", "encoding": "raw", "space origin": "(-60,-64,-70)"},
    }
    right = once(lambda folder: (save_labels(folder / "a.nii.gz"), read_labels(folder / "a.nii.gz"))[1])

    def read(name: str, text: str, data: bytes, beside: bytes, folder: Path):
        (folder / "a.raw").write_bytes(beside)
        (folder / name).write_bytes(text.encode() + data)
        return read_labels(folder / name)

    def of_meta(more: str = "", where: str = "LOCAL", data: bytes = voxels, **changed) -> partial:
        said = "".join(f"{key} = {value}\n" for key, value in (meta | changed).items())
        return partial(read, "a.mha", said + more + f"ElementDataFile = {where}\n", data, voxels)

    def of_nrrd(more: str = "", data: bytes = voxels, left_out: tuple = (), **changed) -> partial:
        said = {key: value for key, value in (nrrd | changed).items() if key not in left_out}
        lines = "".join(f"{key}: {value}\n" for key, value in said.items())
        return partial(read, "a.nrrd", "NRRD0004\n" + lines + more + "\n", data, voxels)

    yield Tried("headers: MetaImage", of_meta(), right)
    yield Tried(
        "headers: MetaImage that is compressed", of_meta(CompressedData="True", data=zlib.compress(voxels)), right
    )
    for key, values in {
        "ElementSpacing": ("-4 4 4", "4 4 -4", "0 4 4", "1e-9 4 4", "nan 4 4", "4 4", "4,4,4", "\u0664 4 4", ""),
        "Offset": ("1e9 0 0", "nan 0 0", "0 0", "1e400 0 0"),
        "TransformMatrix": ("0 0 0 0 0 0 0 0 0", "1 0 0 1 0 0 0 0 1", "1 0 0 0 1 0 0 0 nan", "1 0 0 0 1 0 0 0"),
        "DimSize": ("30 32", "30 32 35", "-30 -32 34", "30 32 34.0", "99999999999 1 1", "0 0 0"),
        "NDims": ("2", "0", "nan", "3 3"),
        "ElementType": ("MET_SHORT", "MET_FLOAT", "MET_STRING", ""),
        "CompressedData": ("True",),
    }.items():
        for value in values:
            yield Tried(f"headers: MetaImage with {key} = {value!r}", of_meta(**{key: value}))
    for more in ("ElementSpacing = 4 4 3\n", "ElementSize = 2 2 2\n", "Position = 5 5 5\n", "DimSize = 30 32 34\n"):
        yield Tried(f"headers: MetaImage with {more.strip()} too", of_meta(more))
    for where in ("a.raw", "", ".", "LIST", "a%03d.raw 1 34 1", "b.raw", "a" * 300, "a\0.raw", "/etc/hostname"):
        yield Tried(f"headers: MetaImage with voxels in {where[:20]!r}", of_meta(where=where, data=b""))
    yield Tried("headers: NRRD", of_nrrd(), right)
    yield Tried("headers: NRRD in mm", of_nrrd('space units: "mm" "mm" "mm"\n'), right)
    yield Tried("headers: NRRD that skips", of_nrrd("byte skip: 70\n", data=b"skipped" * 10 + voxels), right)
    yield Tried("headers: NRRD that skips back", of_nrrd(f"byte skip: -{len(voxels)}\n", data=b""))
    for unit in ("m", "cm", "um"):
        yield Tried(f"headers: NRRD in {unit}", of_nrrd(f'space units: "{unit}" "{unit}" "{unit}"\n'))
    plain = ("space", "space directions", "space origin")
    for sizes in ("4 nan 4", "4 -4 4", "4 0 4", "4 x 4"):
        yield Tried(f"headers: NRRD with spacings {sizes}", of_nrrd(f"spacings: {sizes}\n", left_out=plain))
    for key, values in {
        "space directions": ("(0,0,0) (0,4,0) (0,0,4)", "(nan,0,0) (0,4,0) (0,0,4)", "(4,0,0) (0,4,0)", "4 4 4"),
        "space origin": ("(nan,0,0)", "(0,0)", "(1e9,0,0)"),
        "sizes": ("30 32 34 1", "0 32 34", "30.0 32 34"),
        "encoding": ("ascii", "hex", "bzip2", "gzip"),
        "data file": ("LIST", "LIST 2", "a%03d.raw 0 33 1", "a.raw", "b.raw", "."),
    }.items():
        for value in values:
            yield Tried(f"headers: NRRD with {key}: {value}", of_nrrd(data=b"", **{key: value}))
    gipl = written(save_labels, "a.gipl")
    for name, at, value in (
        ("a negative size", 10, np.float32(-4)),
        ("no size", 14, np.float32(0)),
        ("a size that is NaN", 18, np.float32(np.nan)),
        ("an origin that is NaN", 204, np.float64(np.nan)),
        ("another type", 8, np.int16(31)),
    ):
        changed = gipl[:at] + value.byteswap().tobytes() + gipl[at + value.nbytes :]
        yield Tried(f"headers: GIPL with {name}", partial(_read_bytes, read_labels, "a.gipl", changed))


def dicom(rng: np.random.Generator, count: int) -> Iterator[Tried]:
    """DICOM-SEG: cut, changed, and with a header that says something else than the frames."""
    masks = np.stack([code == head().T for code in CODES.values()], axis=-1)
    grid = np.eye(3), np.full(3, 4.0), np.array([-60.0, -64.0, -70.0])
    content = written(lambda path: save_dicom_seg(path, masks, list(CODES), *grid), "a.dcm")

    def read(path: Path):
        made = read_segmentation(path, "P1", {name: name for name in CODES}, SEGMENTS)
        return made.labels, made.spacing, made.origin, made.segments

    yield from of_bytes("dicom", "a.dcm", content, read, rng, count, sealed=np.inf)  # it has no checksum

    def act(change: Callable, folder: Path):
        stored = pydicom.dcmread(io.BytesIO(content))
        frames, shared = stored.PerFrameFunctionalGroupsSequence, stored.SharedFunctionalGroupsSequence[0]
        change(stored, frames, shared.PixelMeasuresSequence[0], shared.PlaneOrientationSequence[0])
        stored.save_as(folder / "a.dcm")
        return read(folder / "a.dcm")

    def put(name: str, value) -> Callable:
        return lambda stored, *_: setattr(stored, name, value(stored) if callable(value) else value)

    yield Tried(
        "dicom: as it should be", partial(act, lambda *_: None), once(partial(_read_bytes, read, "a.dcm", content))
    )
    changes = {
        "voxels less": put("PixelData", lambda stored: stored.PixelData[:-500]),
        "no voxels": lambda stored, *_: delattr(stored, "PixelData"),
        "frames less": put("NumberOfFrames", lambda stored: stored.NumberOfFrames - 3),
        "frames more": put("NumberOfFrames", lambda stored: stored.NumberOfFrames + 3),
        "no list of frames": lambda stored, *_: delattr(stored, "PerFrameFunctionalGroupsSequence"),
        "another height": put("Rows", 31),
        "no height": put("Rows", 0),
        "other bits": put("BitsAllocated", 8),
        "another kind": put("SegmentationType", "FRACTIONAL"),
        "a label map": put("SegmentationType", "LABELMAP"),
        "a CT": put("SOPClassUID", "1.2.840.10008.5.1.4.1.1.2"),
        "a segment that is not listed": lambda stored, *_: stored.SegmentSequence.pop(1),
        "a name twice": lambda stored, *_: setattr(stored.SegmentSequence[1], "SegmentLabel", "superficial"),
        "a frame of no segment": lambda _, frames, *__: setattr(
            frames[3].SegmentIdentificationSequence[0], "ReferencedSegmentNumber", 99
        ),
        "a frame without a segment": lambda _, frames, *__: delattr(frames[3], "SegmentIdentificationSequence"),
        "a frame nowhere": lambda _, frames, *__: setattr(
            frames[3].PlanePositionSequence[0], "ImagePositionPatient", [0, 0, 5]
        ),
    }
    for size in ([0, 0], [-4, 4], [1e9, 4], [1e-9, 1e-9], [4]):
        changes[f"pixels of {size}"] = lambda *parts, size=size: setattr(parts[2], "PixelSpacing", size)
    for axes in ([1, 0, 0, 1, 0, 0], [0, 0, 0, 0, 0, 0], [2, 0, 0, 0, 2, 0]):
        changes[f"axes {axes}"] = lambda *parts, axes=axes: setattr(parts[3], "ImageOrientationPatient", axes)
    for name, change in changes.items():
        yield Tried(f"dicom: {name}", partial(act, change))


# ---- scans and surfaces


@cache
def face() -> tuple[np.ndarray, np.ndarray]:
    made = head()
    return skin_surface(made, np.full(3, 4.0), np.zeros(3), 6.0)


def scans(rng: np.random.Generator, count: int) -> Iterator[Tried]:
    points, faces = face()

    def read(path: Path):
        return read_postop(path, "P1", points)

    def ascii_ply(path: Path) -> None:
        lines = ["ply", "format ascii 1.0", f"element vertex {len(points)}", *(f"property float {x}" for x in "xyz")]
        lines += [f"element face {len(faces)}", "property list uchar int vertex_indices", "end_header"]
        lines += [" ".join(f"{x:.3f}" for x in point) for point in points]
        lines += ["3 " + " ".join(map(str, corners)) for corners in faces]
        path.write_text("\n".join(lines) + "\n")

    def obj(path: Path) -> None:
        lines = ["v " + " ".join(f"{x:.3f}" for x in point) for point in points]
        lines += ["f " + " ".join(str(corner + 1) for corner in corners) for corners in faces]
        path.write_text("\n".join(lines) + "\n")

    # None of these formats has a checksum: what is cut off is noticed, a turned digit is not; OBJ may end anywhere.
    for name, write in (("a.ply", None), ("b.ply", ascii_ply), ("a.stl", None), ("a.vtp", None)):
        content = written(write or partial(write_surface, points, faces), name)
        yield from of_bytes("scan", name, content, read, rng, count, sealed=np.inf)
    text = written(obj, "a.obj")
    for what, data in damaged(text, rng, count):
        yield Tried(f"scan: a.obj: {what}", partial(_read_bytes, read, "a.obj", data), ...)
    right = once(partial(_read_bytes, read, "a.obj", text))
    yield Tried("scan: a marked a.obj", partial(_read_bytes, read, "a.obj", b"\xef\xbb\xbf" + text), right)
    corners = ("\n".join("vertex " + " ".join(f"{x:.3f}" for x in point) for point in points[face]) for face in faces)
    facets = "".join(f"facet normal 0 0 0\nouter loop\n{three}\nendloop\nendfacet\n" for three in corners)
    stl = f"solid a, b\n{facets}endsolid\n"
    for name, data, wanted in (("points", stl, ...), ("commas", stl.replace(".", ","), None)):
        yield Tried(f"scan: STL with decimal {name}", partial(_read_bytes, read, "c.stl", data.encode()), wanted)
    whole = written(partial(write_surface, points, faces), "a.ply")
    for name, old, new in (
        ("more vertices", f"element vertex {len(points)}", f"element vertex {10**9}"),
        ("fewer vertices", f"element vertex {len(points)}", f"element vertex {len(points) - 1}"),
        ("more faces", f"element face {len(faces)}", f"element face {len(faces) + 1}"),
        ("fewer faces", f"element face {len(faces)}", f"element face {len(faces) - 1}"),
        ("minus vertices", f"element vertex {len(points)}", "element vertex -5"),
        ("doubles", "property float x", "property double x"),
        ("no type", "property float x", "property flaot x"),
        ("other bytes", "binary_little_endian", "binary_big_endian"),
        ("text", "binary_little_endian", "ascii"),
        ("no z", "property float z\n", ""),
    ):
        assert old.encode() in whole
        data = whole.replace(old.encode(), new.encode())
        yield Tried(f"scan: PLY with {name}", partial(_read_bytes, read, "a.ply", data))
    plain, drawn, filed = (
        written(write, f"b.{kind}").decode()
        for write, kind in ((ascii_ply, "ply"), (obj, "obj"), (partial(write_surface, points, faces), "vtp"))
    )
    triangle, corner = "3 " + " ".join(map(str, faces[-1])), "f " + " ".join(str(corner + 1) for corner in faces[-1])
    nothing = plain.replace(triangle, "3 0 0 0")
    for corners in faces:
        nothing = nothing.replace("\n3 " + " ".join(map(str, corners)) + "\n", "\n3 0 0 0\n")
    for name, old, new in (
        ("b.ply", triangle, triangle + ".5"),
        ("b.ply", triangle, triangle.replace("3 ", "3.5 ", 1)),
        ("b.ply", triangle, triangle.replace("3 ", "nan ", 1)),
        ("b.ply", triangle, triangle[:-1] + "_" + triangle[-1]),
        ("b.ply", plain, nothing),
        ("b.obj", corner, corner + "/99999"),
        ("b.obj", corner, corner + "//-1"),
        ("b.obj", corner, corner[:-1] + "_" + corner[-1]),
        ("b.vtp", f'NumberOfPoints="{len(points)}"', 'NumberOfPoints="99999999999999"'),
        ("b.vtp", f'NumberOfPolys="{len(faces)}"', 'NumberOfPolys="99999999999"'),
    ):
        text = {"b.ply": plain, "b.obj": drawn, "b.vtp": filed}[name]
        assert old in text
        data = text.replace(old, new).encode()
        yield Tried(f"scan: {name}: {old[:30]!r} is {new[:40]!r}", partial(_read_bytes, read, name, data))
    wild = bytearray(whole)
    wild[-4:] = (2**31 - 1).to_bytes(4, "little")
    yield Tried("scan: a face beyond the points", partial(_read_bytes, read, "a.ply", bytes(wild)))
    wild[-4:] = (-7).to_bytes(4, "little", signed=True)
    yield Tried("scan: a face before the points", partial(_read_bytes, read, "a.ply", bytes(wild)))

    mixed = rng.permutation(len(points))
    for name, scattered, drawn in (
        ("points in another order than its faces", points[mixed], faces),
        ("triangles anywhere", points, mixed[faces]),
    ):
        data = written(partial(write_surface, scattered, drawn), "a.stl")
        yield Tried(f"scan: {name}", partial(_read_bytes, read, "a.stl", data))
    spiked = points.copy()
    spiked[len(spiked) // 2] += [0, 400.0, 0]

    def read_spiked(folder: Path):
        write_surface(spiked, faces, folder / "a.ply")
        placed, triangles = read(folder / "a.ply")
        return bool(len(placed) >= len(points) - 3 and np.ptp(placed, axis=0).max() < 150 and len(triangles))

    yield Tried("scan: a spike of 400 mm", read_spiked, True)
    for factor, right in ((0.1, True), (0.001, True), (1 / 25.4, None), (1e3, None), (0.0, None), (np.inf, None)):

        def scaled(folder: Path, factor=factor):
            with np.errstate(invalid="ignore"):
                write_surface(points * factor, faces, folder / "a.stl")
            return bool(np.abs(np.ptp(read(folder / "a.stl")[0], axis=0) / np.ptp(points, axis=0) - 1).max() < 1e-3)

        yield Tried(f"scan: {factor} times as large", scaled, right)


def _read_bytes(read, name: str, data: bytes, folder: Path):
    (folder / name).write_bytes(data)
    return read(folder / name)


# ---- plans


def plan_of(**parts) -> dict:
    motion = {"rotation": np.eye(3).tolist(), "translation": [0, -5, 0], "pivot": [1, 2, 3]} | parts
    return {"case": "P1", "frame": "LPS", "units": "mm", "segments": {"lefort1": motion, "mandible": motion}}


def motions(plan: Plan):
    return {name: (motion.rotation, motion.translation, motion.pivot) for name, motion in plan.motions.items()}


def plans(rng: np.random.Generator, count: int) -> Iterator[Tried]:
    def read(path: Path):
        return motions(Plan.read(path, "P1"))

    text = json.dumps(plan_of())
    right = once(partial(_read_bytes, read, "a.json", text.encode()))
    cases: dict[str, tuple[bytes, object]] = {
        "byte-order mark": (b"\xef\xbb\xbf" + text.encode(), right),
        "indented": (json.dumps(plan_of(), indent=3).encode(), right),
        "keys in another order": (json.dumps(plan_of(), sort_keys=True).encode(), right),
        "exponents": (text.replace("-5", "-0.5e1").encode(), right),
        "carriage returns": (json.dumps(plan_of(), indent=1).replace("\n", "\r\n").encode(), right),
        "UTF-16": (text.encode("utf-16"), None),
        "UTF-32": (text.encode("utf-32"), None),
        "Latin-1": (text.replace("P1", "P\xe4").encode("latin-1"), None),
        "binary": (rng.bytes(500), None),
        "nothing": (b"", None),
        "null": (b"null", None),
        "a list": (b"[1, 2]", None),
        "deep lists": (b'{"segments": ' + 100_000 * b"[" + 100_000 * b"]" + b"}", None),
        "deep objects": (100_000 * b'{"segments": ' + b"1" + 100_000 * b"}", None),
        "a long number": (text.replace("-5", "1" + 5000 * "0").encode(), None),
        "a key twice": (text.replace('"case": "P1"', '"case": "P2", "case": "P1"').encode(), None),
        "two plans": (text.encode() * 2, None),
        "a comment": (b"// plan\n" + text.encode(), None),
        "single quotes": (text.replace('"', "'").encode(), None),
        "a comma at the end": (text[:-1].encode() + b",}", None),
    }
    wrong = [True, False, None, "5", "5,5", [], {}, [0, 1], [0, 1, 2, 3], [[0, 1, 2]], 1e9, -1e9, 51, 10**400]
    wrong += [float("nan"), float("inf"), [0, "1", 2], [0, True, 0], [0, None, 0], [0, float("nan"), 0]]
    wrong += [[10**400, 0, 0], [0, 60, 0], [1e308, 1e308, 0]]
    for key in ("rotation", "translation", "pivot"):
        for value in wrong:
            if key == "pivot" and value == [0, 60, 0]:
                continue  # a place like any other
            cases[f"{key} {str(value)[:30]}"] = (json.dumps(plan_of(**{key: value})).encode(), None)
        gone = plan_of()
        del gone["segments"]["lefort1"][key]
        if key != "pivot":
            cases[f"without {key}"] = (json.dumps(gone).encode(), None)
    for size in (1e-3, 0.1, 2.0, -1.0):
        cases[f"rotation scaled by {size}"] = (json.dumps(plan_of(rotation=(size * np.eye(3)).tolist())).encode(), None)
    for _ in range(count):
        turned = np.eye(3) + rng.normal(scale=0.01, size=(3, 3))
        cases[f"no rotation {turned[0, 1]:.6f}"] = (json.dumps(plan_of(rotation=turned.tolist())).encode(), None)
        at = int(rng.integers(1, len(text)))
        cases[f"cut at {at}"] = (text[:at].encode(), None)
    strange = ("unit", "coordinate_system", "Frame", "segment", "name", "", "frame ", "scale", "comment")
    for key in strange:
        cases[f"with the key {key!r}"] = (json.dumps(plan_of() | {key: "cm"}).encode(), None)
        cases[f"a motion with the key {key!r}"] = (json.dumps(plan_of(**{key: 1})).encode(), None)
    heads = [{"frame": "RAS"}, {"frame": None}, {"units": "cm"}, {"units": 1}, {"case": 3}, {"case": "P2"}]
    heads += [{"case": None}, {"convention": "x"}]
    for head_ in (*heads, {"segments": []}, {"segments": {"lefort1": 5}}, {"segments": None}):
        cases[f"head {head_}"] = (json.dumps(plan_of() | head_).encode(), None)
    for name, (data, result) in cases.items():
        yield Tried(f"plan: {name}", partial(_read_bytes, read, "a.json", data), result)


# ---- markups


def markups(rng: np.random.Generator, count: int) -> Iterator[Tried]:
    def read(path: Path):
        markups_read = read_markups([path], "P1")
        return markups_read.points, markups_read.regions

    def text_of(**parts) -> bytes:
        markup = {"type": "Fiducial", "coordinateSystem": "LPS", "coordinateUnits": "mm"}
        markup["controlPoints"] = [{"label": "A", "position": [1, 2.5, -3]}]
        return json.dumps({"markups": [markup | parts]}).encode()

    yield from of_bytes("markups", "a.mrk.json", text_of(), read, rng, count, sealed=np.inf)
    strange = [["1", "2", "3"], [True, False, True], [1, 2], [1, 2, None], [[1, 2, 3]], "123", 1e400, {}]
    for place in [*strange, [1e299, 0, 0]]:
        points = [{"label": "A", "position": place}]
        yield Tried(f"markups: at {place}", partial(_read_bytes, read, "a.mrk.json", text_of(controlPoints=points)))
    for size in ([-10, 10, 10], [0, 10, 10], [10, 10], ["10", "10", "10"], 10, None):
        data = text_of(type="ROI", center=[0, 0, 0], size=size)
        yield Tried(f"markups: a region of {size}", partial(_read_bytes, read, "a.mrk.json", data))
    right = once(partial(_read_bytes, read, "a.mrk.json", text_of()))
    units = text_of(coordinateUnits=["mm", "UCUM", "millimeter"])
    yield Tried("markups: units as a list", partial(_read_bytes, read, "a.mrk.json", units), right)
    for key, value in (
        ("coordinateSystem", "IJK"),
        ("coordinateUnits", "m"),
        ("coordinateUnits", ["m", "UCUM", "metre"]),
        ("controlPoints", [1]),
        ("type", "Plane"),
    ):
        data = text_of(**{key: value})
        yield Tried(f"markups: {key} {value}", partial(_read_bytes, read, "a.mrk.json", data))


# ---- transforms


def transforms(rng: np.random.Generator, count: int) -> Iterator[Tried]:
    made = sitk.Euler3DTransform((1.0, -2.0, 30.0), 0.02, -0.01, 0.03, (0.5, -4.0, 1.5))

    def read(path: Path):
        folder = path.parent / "plan"
        folder.mkdir()
        path.rename(folder / f"lefort1{path.suffix}")
        return {key: (motion.rotation, motion.translation) for key, motion in read_transforms(folder, "P1").items()}

    contents = {}
    for name in ("a.tfm", "a.txt", "a.h5", "a.mat"):
        contents[name] = written(lambda path: sitk.WriteTransform(made, str(path)), name)
        yield from of_bytes("transform", name, contents[name], read, rng, count, sealed=np.inf)
    text = contents["a.tfm"].decode()
    lines = text.splitlines(keepends=True)
    changes = {
        "a decimal comma": text.replace("0.5", "0,5"),
        "a parameter less": "".join(
            line.rsplit(" ", 1)[0] + "\n" if line.startswith("Par") else line for line in lines
        ),
        "a parameter more": "".join(line.rstrip() + " 1\n" if line.startswith("Par") else line for line in lines),
        "two parameters": "".join("Parameters: 1 2\n" if line.startswith("Par") else line for line in lines),
        "no parameters": "".join("Parameters:\n" if line.startswith("Par") else line for line in lines),
        "no fixed parameters": "".join(line for line in lines if not line.startswith("Fixed")),
        "half the fixed parameters": "".join(
            "FixedParameters: 1\n" if line.startswith("Fix") else line for line in lines
        ),
        "another class": text.replace("Euler3DTransform", "BSplineTransform"),
        "no such class": text.replace("Euler3DTransform", "RigidTransform"),
        "a blank that is none": text.replace(" -4", "\u00a0-4"),
        "a separator that is none": text.replace(" -4", "\x1f-4"),
        "parameters twice": text + "Parameters: 0 0 0 0 0 0\n",
        "a switch between 0 and 1": text.replace(" 30 0\n", " 30 0.7\n"),
        "a versor longer than 1": text.replace("Euler3DTransform", "VersorRigid3DTransform").replace("0.02", "1.02"),
        "two dimensions": text.replace("_3_3", "_2_2"),
        "two transforms": text + text.split("\n", 2)[2],
        "UTF-16": None,
    }
    for number in ("half", "nan", "inf", "1e999", "1e308", "0x1p-1", "\u0660.\u0665"):
        changes[f"the number {number}"] = text.replace("0.5", number)
    for name, changed in changes.items():
        data = text.encode("utf-16") if changed is None else changed.encode()
        assert data != text.encode(), name
        yield Tried(f"transform: {name}", partial(_read_bytes, read, "a.tfm", data))
    right = once(partial(_read_bytes, read, "a.tfm", text.encode()))
    for name, data in (
        ("carriage returns", text.replace("\n", "\r\n").encode()),
        ("a byte-order mark", b"\xef\xbb\xbf" + text.encode()),
    ):
        yield Tried(f"transform: {name}", partial(_read_bytes, read, "a.tfm", data), right)


# ---- tables


def tables(rng: np.random.Generator, count: int) -> Iterator[Tried]:
    head_ = "case\tsegmentation\tplan\tpostop\tage\n"
    row = "P1\ta.nii.gz\ta.json\t\t30\n"

    def read(data: bytes, folder: Path):
        for name in ("a.nii.gz", "a.json"):
            (folder / name).touch()
        (folder / "cases.tsv").write_bytes(data)
        cases = read_cases(folder / "cases.tsv")
        return [(case.name, Path(case.plan).name, dict(case.covariates)) for case in cases]

    right = [("P1", "a.json", {"age": 30.0})]
    cases: dict[str, tuple[bytes, object]] = {
        "as it should be": ((head_ + row).encode(), right),
        "a byte-order mark": (b"\xef\xbb\xbf" + (head_ + row).encode(), right),
        "carriage returns": ((head_ + row).replace("\n", "\r\n").encode(), right),
        "no end of line": ((head_ + row).rstrip("\n").encode(), right),
        "an empty line": ((head_ + row + "\n").encode(), right),
        "empty rows and columns": (
            "".join(f"{line}\t\t\n" for line in (*(head_ + row).split("\n")[:2], 4 * "\t")).encode(),
            right,
        ),
        "UTF-16": ((head_ + row).encode("utf-16"), None),
        "Latin-1": ((head_ + row.replace("P1", "J\xf6rg")).encode("latin-1"), None),
        "NUL": ((head_ + row.replace("P1", "P\0")).encode(), None),
        "binary": (rng.bytes(400), None),
        "nothing": (b"", None),
        "a quote that never ends": ((head_ + '"' + row).encode(), None),
        "semicolons": ((head_ + row).replace("\t", ";").encode(), right),
        "a German Excel": (("sep=;\r\n" + (head_ + row).replace("\t", ";").replace("30", "30,0")).encode(), right),
        "a column unknown": ((head_.replace("age", "Age") + row).encode(), None),
        "a path too long": ((head_ + row.replace("a.json", "a" * 300)).encode(), None),
        "a huge field": ((head_ + row.replace("P1", "P" * 200_000)).encode(), None),
    }
    names = ["-P1", "--help", "P 1", "P/1", "..", ".", "", "P1.nii", "P\t1", "Jörg", "P１", "P²", 65 * "P", "P*"]
    names += ["P'1", "$P"]
    for name in names:
        cases[f"the name {name[:20]!r}"] = ((head_ + row.replace("P1", name)).encode(), None)
    for name in ("p1", "P1", " P1"):
        cases[f"{name!r} beside 'P1'"] = ((head_ + row + row.replace("P1", name)).encode(), None)
    for age in ("nan", "inf", "-1", "1e9", "thirty", "3,0,5", "3_0", "0x10", "٣٠٠"):
        cases[f"an age of {age}"] = ((head_ + row.replace("30", age)).encode(), None)
    for _ in range(count):
        name = "".join(rng.choice(list("ABCdef019_-"), rng.integers(1, 65)))
        good = [(name, "a.json", {"age": 30.0})] if not name.startswith("-") else None
        cases[f"the name {name}"] = ((head_ + row.replace("P1", name)).encode(), good)
    for name, (data, result) in cases.items():
        yield Tried(f"table: {name}", partial(read, data), result)


# ---- configurations


def places(value, place=()) -> Iterator[tuple]:
    """The place of every plain value of a configuration."""
    if isinstance(value, dict):
        for key, part in value.items():
            yield from places(part, (*place, key))
    else:
        yield place


def configs(rng: np.random.Generator, count: int) -> Iterator[Tried]:
    # A text in 'labels' is a name like any other.
    numbers = [place for place in places(CONFIG) if type(_at(CONFIG, place)) in (int, float) and place[0] != "labels"]
    for value in (float("nan"), float("inf"), float("-inf"), ".nan", "-.inf", "nan", 1e301, 10**400, "1e999"):
        for index in rng.choice(len(numbers), min(count, len(numbers)), replace=False):
            yield _config(numbers[index], value, None)
    for value in ({}, "\0", "ten", None, [[]], {"a": 1}):
        for index in rng.choice(len(numbers), min(count, len(numbers)), replace=False):
            yield _config(numbers[index], value, ... if value is None else None)
    for place in numbers[:: max(1, len(numbers) // (10 * count))]:
        yield _config(place, _at(CONFIG, place), ...)  # as it stands
    yield _config(("registration", "limit"), float("nan"), None)
    for place in (("convergence", 1), ("fem", None), ("mesh", True), ("virtual", 2.5)):
        yield _config(place, 1, None)
    for place in (("registratoin",), ("mesh", "Nodes"), ("fem", "")):
        yield _config(place, 1, None)


def _at(value, place):
    for key in place:
        value = value[key]
    return value


def _config(place: tuple, value, right) -> Tried:
    def act(_folder: Path):
        changed = json.loads(json.dumps(CONFIG))
        _at(changed, place[:-1])[place[-1]] = value
        read = checked(changed, SCHEMA)
        check_config(read)
        if any(isinstance(_at(read, at), float) and not np.isfinite(_at(read, at)) for at in places(read)):
            raise AssertionError("a number that is not finite went in")

    return Tried(f"config: {'.'.join(map(str, place))} = {str(value)[:20]!r} ({type(value).__name__})", act, right)


# ---- what the study makes itself


def intermediates(rng: np.random.Generator, count: int) -> Iterator[Tried]:
    patient = tiny_patient()
    made = head()
    grid = np.full(3, 4.0), np.zeros(3)
    bone, skin = bone_surface(made, *grid, SEGMENTS, 6.0), face()
    prediction = {"P1": Prediction(np.ones_like(patient.points), load=0.5)}
    lift = Lift(*(rng.normal(size=(4, 5)).astype(np.float32) for _ in range(5)), seconds=1.0)
    postop = PostopSkin(*skin, 0.2)
    torch.manual_seed(0)
    settings = network_settings(boundary_layers=1, volume_layers=1, rest_layers=1, channels=8, heads=2, decoder_width=8)
    network = build(settings)

    interval = Interval(patient.points, np.ones(len(patient.points)), np.ones(9), np.ones(9, np.int8))
    imported = {"case": "tiny", "muscle": "labelled", "repairs": [{"structure": "left", "what": "kept", "voxels": 3}]}
    imported["volume_cm3"] = dict.fromkeys(internal_codes(patient.segments), 1.5)
    covariates = Covariates("male", 30.5, 23.1, 6.2, "vy", True)

    def arrays(value) -> dict:
        return {item.name: getattr(value, item.name) for item in fields(value)}

    def read_tensors(path: Path):
        network, form = read_network(path, NetworkSettings, build, "cpu")
        return {name: value.numpy() for name, value in network.state_dict().items()} | {"settings": str(asdict(form))}

    def read_outcome(path: Path):
        *field, executed = read_truth(path, "tiny")
        return field, motions(executed)

    def save_json(value: dict, path: Path) -> None:
        path.write_text(json.dumps(value, indent=1) + "\n")

    sealed = {
        "model.h5": (patient.write, lambda path: arrays(PatientModel.read(path))),
        "lift.h5": (lift.write, lambda path: arrays(Lift.read(path))),
        "predictions.h5": (
            lambda path: write_predictions(path, prediction),
            lambda path: arrays(read_prediction(path, "P1")),
        ),
        "postop.h5": (postop.write, lambda path: arrays(PostopSkin.read(path))),
        "network.pt": (lambda path: save_network(path, network, settings), read_tensors),
        "bone.vtp": (bone.write, lambda path: arrays(BoneSurface.read(path))),
        "skin.vtp": (lambda path: write_surface(*skin, path), read_surface),
        "mesh.vtu": (kuhn_cube(3).write, lambda path: arrays(TetMesh.read(path))),
        "labels.nii.gz": (
            lambda path: write_segmentation(made, *grid, path),
            lambda path: sitk.GetArrayFromImage(read_stored_image(path)),
        ),
        "interval.h5": (interval.write, lambda path: arrays(Interval.read(path))),
    }
    # A turned digit is another number; a table of several rows may end after any of them.
    plain = {
        "plan.json": (tiny_plan().write, lambda path: motions(Plan.read(path, "tiny"))),
        "truth.h5": (Outcome(patient, patient.points, tiny_plan(), patient.points).write, read_outcome),
        "covariates.json": (covariates.write, lambda path: asdict(Covariates.read(path))),
        "report.json": (partial(save_json, imported), lambda path: quality(patient, read_stored_json(path))),
        "quality.json": (
            partial(save_json, quality(patient, imported)),
            lambda path: tabulate([path], patient.segments, "").frame.to_dict("records"),
        ),
        "cases.csv": (
            lambda path: write_csv(pd.DataFrame([row("P1", "pinnochio", 1.0)]), path, CASES),
            lambda path: read_table(path, CASES).to_dict("records"),
        ),
        "benchmark.tsv": (
            lambda path: benchmark(path, 12.5, 20.0, 300.0),
            lambda path: read_benchmark(path).to_dict("records"),
        ),
    }
    kinds = sealed | plain
    for name, (write, read) in kinds.items():
        yield from of_bytes(
            "intermediate", name, written(write, name), read, rng, count, sealed=0 if name in sealed else np.inf
        )
    for name, (_, read) in kinds.items():
        yield Tried(f"intermediate: no {name}", lambda folder, name=name, read=read: read(folder / name))


def external(rng: np.random.Generator, count: int) -> Iterator[Tried]:
    patient = tiny_patient()

    def read(path: Path):
        return read_external(path, "P1", patient.points, patient.cells).displacement

    field = rng.normal(size=patient.points.shape)

    def save(value, folder: Path):
        np.savez(folder / "a.npz", displacement=value)
        return read(folder / "a.npz")

    yield Tried("external: as it should be", partial(save, field), field)
    for value in (np.nan, np.inf, 1e308, -1e308, 1e4, 101.0):
        wrong = field.copy()
        wrong[3, 1] = value
        yield Tried(f"external: a node moved by {value:g} mm", partial(save, wrong))
    yield from of_bytes(
        "external", "a.npz", written(lambda p: np.savez(p, displacement=field), "a.npz"), read, rng, count
    )


# ---- archives


def archives(rng: np.random.Generator, count: int) -> Iterator[Tried]:
    files = {
        "ranges.json": b'{"a": 1}\n',
        "m/1.pt": rng.bytes(300),
        "m/2.pt": rng.bytes(300),
        "m/calibration.json": b"{}",
    }

    def packed(folder: Path) -> Path:
        for name, content in files.items():
            (folder / name).parent.mkdir(exist_ok=True)
            (folder / name).write_bytes(content)
        methods = {"m": {"corrections": 1, "lift": "elastic", "usual": {"eqres_rel": [0.1, 0.2, 0.3]}}}
        Archive("clinic", 12, list(SEGMENTS), ["1", "2"], methods, {}, "abc", "def").write(folder)
        return folder

    def act(name: str, data: bytes | None, folder: Path):
        packed(folder)
        if data is None:
            (folder / name).unlink()
        else:
            (folder / name).write_bytes(data)
        return asdict(Archive.read(folder))

    right = once(lambda folder: asdict(Archive.read(packed(folder))))
    manifest = once(lambda folder: (packed(folder) / "archive.json").read_bytes())
    for name, content in (files | {"archive.json": manifest}).items():
        for what, data in damaged(content, rng, count):
            yield Tried(f"archive: {name}: {what}", partial(act, name, data), right)
        yield Tried(f"archive: no {name}", partial(act, name, None))
    yield Tried("archive: models exchanged", partial(act, "m/1.pt", files["m/2.pt"]))


KINDS = {
    kind.__name__: kind
    for kind in (
        *(labels, scans, plans, markups, transforms, tables),
        *(configs, intermediates, external, archives),
        *(headers, dicom, doors),
    )
}


def inputs(kind: str, seed: int, count: int) -> list[Tried]:
    """Inputs of a kind, each with a name of its own; count: how many of each random damage."""
    made = {tried.name: tried for tried in KINDS[kind](np.random.default_rng([seed, list(KINDS).index(kind)]), count)}
    return list(made.values())
