"""One head that a free tool has segmented, as clinics bring it: each input becomes that head or is refused."""

import json
import struct
from collections.abc import Iterator
from functools import cache, partial
from pathlib import Path

import numpy as np
import pyvista as pv
import SimpleITK as sitk

from pinnochio.study.patients import read_patients
from pinnochio.virtual.head import build_head
from pinnochio.virtual.scanned import sample_patient
from tests.helpers import tools
from tests.helpers.dicom import save_dicom_seg, save_frames, save_series
from tests.helpers.judging import Tried

SPACING = 3.5
NAMES = ("Maxilla & Upper Skull", "Mandible", "Upper Teeth", "Lower Teeth", "Mandibular canal")
STEMS = ("Upper_Skull", "mandible", "upper_teeth", "lower_teeth", "mandibular_canal")
BONE = 0.002  # share by which a bone may differ
TISSUE = 0.03  # share by which soft tissue may differ where the scan is another one


@cache
def made():
    """The head, its label map, its scan and the volumes that its import gives."""
    import tempfile

    head = build_head(sample_patient(np.random.default_rng(3), "class_iii"), SPACING)
    values, grey = tools.dental(head), tools.scan(head)
    with tempfile.TemporaryDirectory() as folder:
        volumes = imported(Path(folder), values, grey, head)
    return head, values, grey, volumes


def imported(folder: Path, values=None, grey=None, head=None, save=None, **settings) -> dict:
    """Volumes of a patient's folder that holds a label map and a scan; save(folder) writes others instead."""
    if head is None:
        head, usual, scan, _ = made()
        values, grey = usual if values is None else values, scan if grey is None else grey
    home = folder / "P1"
    home.mkdir()
    if values is not None:
        tools.write(home / "segmentation.nii.gz", values, head)
    if grey is not None:
        tools.write(home / "ct.nii.gz", grey, head)
    if save:
        save(home)
    (patient,) = read_patients(home).values()
    markups = [path for path in sorted(home.iterdir()) if path.name.endswith((".mrk.json", ".fcsv"))]
    report, _ = tools.run(folder, patient.segmentation, volume=patient.volume or None, markups=markups, **settings)
    return report["volume_cm3"]


def same_head(folder: Path, **changes) -> bool:
    """Whether the bones are the head's but for a few voxels, which the scan decides, and its soft tissue nearly."""
    volumes, right = imported(folder, **changes), made()[3]
    soft = [sum(of[name] for name in ("superficial", "muscle")) for of in (volumes, right)]
    bones = {name for name in right if name not in ("superficial", "muscle")}
    return all(abs(volumes[name] / right[name] - 1) < BONE for name in bones) and abs(soft[0] / soft[1] - 1) < TISSUE


def named(values, order, folder: Path, layers=False, **changes):
    """Write the label map as 3D Slicer does, its segments by name, of other values or each in a layer with value 1."""
    head, masks = made()[0], [values == value for value in range(1, 6)]
    stored = masks if layers else [np.select(masks, order)]
    names = [changes.get(f"name{number}", name) for number, name in enumerate(NAMES)]
    segments = [(name, order[number], number if layers else 0) for number, name in enumerate(names)]
    tools.write_seg_nrrd(folder / "segmentation.seg.nrrd", stored, segments, np.eye(3), head.spacing, head.origin)


def cropped(mask, path: Path):
    """Write a mask cropped to itself."""
    head, index = made()[0], np.argwhere(mask)
    low = np.maximum(index.min(axis=0) - 1, 0)
    part = mask[tuple(slice(a, b) for a, b in zip(low, index.max(axis=0) + 2, strict=True))]
    tools.write(path, part, head, origin=head.origin + low * head.spacing)


def one_by_one(values, folder: Path, empty=False, percent=False):
    """Write each structure as a file, cropped to itself."""
    (folder / "segmentation").mkdir()
    for value, stem in enumerate(STEMS, 1):
        mask = (values == value).astype(np.uint8)
        if percent and stem == "mandible":
            mask = mask * np.linspace(1, 100, mask.shape[2]).astype(np.uint8)
        cropped(mask, folder / f"segmentation/{stem}.nii.gz")
        if empty and stem == "mandibular_canal":
            tools.write(folder / f"segmentation/{stem}.nii.gz", mask * 0, made()[0])
    (folder / "segmentation/._mandible.nii.gz").write_bytes(b"\0\5\x16\7")


def misnamed(ending: str, folder: Path):
    """Write the label map as a NIfTI whose ending says the other of compressed and not."""
    other = {".nii": "a.nii.gz", ".nii.gz": "a.nii"}[ending]
    tools.write(folder / other, made()[1], made()[0]).rename(folder / f"segmentation{ending}")


def spaceless(values, folder: Path):
    """Write the label map as a NRRD that says nothing of its frame."""
    sizes, spacing = (" ".join(map(str, numbers)) for numbers in (values.shape, made()[0].spacing))
    lines = "NRRD0004", "type: uint8", "dimension: 3", f"sizes: {sizes}", f"spacings: {spacing}", "encoding: raw\n\n"
    (folder / "segmentation.nrrd").write_bytes("\n".join(lines).encode() + values.astype(np.uint8).tobytes(order="F"))


def second_nifti(folder: Path):
    """Write the label map as NIfTI-2."""
    head, values, *_ = made()
    plain = tools.write(folder / "a.nii", values, head)
    old = plain.read_bytes()
    plain.unlink()
    new = bytearray(544)
    moves = "12 2h 70 2h, 16 8q 40 8h, 104 8d 76 8f, 176 2d 112 2f, 344 2i 252 2h, 352 6d 256 6f, 400 12d 280 12f"
    for place, kind, at, source in (move.split() for move in moves.split(", ")):
        struct.pack_into("<" + kind, new, int(place), *struct.unpack_from("<" + source, old, int(at)))
    struct.pack_into("<i8s", new, 0, 540, b"n+2\0\r\n\x1a\n")
    struct.pack_into("<q", new, 168, 544)
    (start,) = struct.unpack_from("<f", old, 108)
    (folder / "Segmentation.nii").write_bytes(bytes(new) + old[int(start) :])


def beside(folder: Path):
    """Write the scan as a header and its voxels in another file, with what tools leave beside it."""
    head, _, grey, _ = made()
    image = sitk.GetImageFromArray(np.rint(grey.transpose(2, 1, 0)).astype(np.int16))
    image.SetSpacing(np.asarray(head.spacing, float).tolist())
    image.SetOrigin(np.asarray(head.origin, float).tolist())
    sitk.WriteImage(image, str(folder / "CT.mhd"))
    (folder / "CT.json").write_text('{"Modality": "CT"}')
    (folder / "._CT.mhd").write_bytes(b"\0\5\x16\7")


def series(folder: Path, beside=0, **changes):
    """Write the scan as slices of DICOM, with some slices of another series beside them."""
    head, _, grey, _ = made()
    grid = np.eye(3), np.asarray(head.spacing), np.asarray(head.origin)
    save_series(folder / "dicom", grey, *grid, **changes)
    if beside:
        save_series(folder / "dicom/other", grey[..., :beside], *grid, series="another")


def frames(folder: Path, **changes):
    """Write the scan as one file of many frames."""
    head, _, grey, _ = made()
    save_frames(folder / "ct.dcm", grey, np.eye(3), np.asarray(head.spacing), np.asarray(head.origin), **changes)


def dicom_seg(folder: Path):
    """Write the label map as DICOM-SEG, with the tool's names."""
    head, values, *_ = made()
    masks = np.stack([values.transpose(2, 1, 0) == value for value in range(1, 6)], axis=-1)
    grid = np.eye(3), np.asarray(head.spacing), np.asarray(head.origin)
    save_dicom_seg(folder / "segmentation.dcm", masks, list(NAMES), *grid)


def tilted(folder: Path):
    """Write the scan as slices of a gantry that was tilted by 15 degrees."""
    head, _, grey, _ = made()
    image = sitk.GetImageFromArray(grey.transpose(2, 1, 0))
    spacing, slope = np.asarray(head.spacing, float), np.tan(np.radians(15))
    image.SetSpacing(spacing.tolist())
    shift = sitk.AffineTransform(3)
    shift.SetMatrix([1, 0, 0, 0, 1, slope, 0, 0, 1])
    size = [int(side) for side in grey.shape]
    size[1] += int(np.ceil(slope * size[2] * spacing[2] / spacing[1]))
    start = [0.0, -slope * size[2] * spacing[2], 0.0]
    sheared = sitk.Resample(image, size, shift, sitk.sitkLinear, start, spacing.tolist(), defaultPixelValue=-1000.0)
    step = spacing[2] * np.array([0, slope, 1])
    voxels = sitk.GetArrayFromImage(sheared).transpose(2, 1, 0)
    save_series(folder / "ct", voxels, np.eye(3), spacing, np.asarray(head.origin) + start, step=step)


def padded(value: float):
    """The scan with a value outside the circle that a scanner sees."""
    grey = made()[2].copy()
    x, y = np.indices(grey.shape[:2])
    radius = [np.hypot(*(np.array(grey.shape[:2]) / 2)) * 0.86]
    grey[np.hypot(x - grey.shape[0] / 2, y - grey.shape[1] / 2) > radius[0]] = value
    return grey


def marked(folder: Path, name="lm.mrk.json", frame="LPS", **places):
    tools.points(folder / name, frame="LPS", **places)
    if frame != "LPS":
        (folder / name).write_text((folder / name).read_text().replace('"LPS"', '"RAS"'))


def doors(rng: np.random.Generator, count: int) -> Iterator[Tried]:
    """Everything that comes through a clinic's door for one head."""
    head, values, grey, volumes = made()
    jaw = np.argwhere(np.isin(values, (2, 4))) * head.spacing + head.origin
    chin = jaw[jaw[:, 1] < jaw[:, 1].min() + 20]
    menton = chin[chin[:, 2].argmin()]
    top = [side[side[:, 2].argmax()] for side in (jaw[jaw[:, 0] < -20], jaw[jaw[:, 0] > 20])]

    def good(name: str, **changes) -> Tried:
        return Tried(f"door: {name}", partial(same_head, **changes), True)

    def bad(name: str, **changes) -> Tried:
        return Tried(f"door: {name}", partial(imported, **changes))

    none = {"values": None, "head": head}
    yield good("as it is")
    yield good("names, values exchanged", **none, grey=grey, save=partial(named, values, (3, 2, 1, 4, 5)))
    yield good("layers of value 1", **none, grey=grey, save=partial(named, values, (1,) * 5, layers=True))
    yield good("names of nobody", **none, grey=grey, save=partial(named, values, (1, 2, 3, 4, 5), name0="Kiefer"))
    yield bad("a name that is none", **none, grey=grey, save=partial(named, values, (3, 2, 1, 4, 5), name0="Kiefer"))
    yield good("files cropped to their structure", **none, grey=grey, save=partial(one_by_one, values))
    yield Tried(
        "door: an empty file",
        lambda folder: imported(folder, None, grey, head, partial(one_by_one, values, empty=True))["lefort1"],
        volumes["lefort1"],
    )
    for name in ("bone.stl", "lefort1.vtk"):
        yield bad(f"{name} beside the labels", **none, grey=grey, save=partial(surface_beside, values, name))
    yield bad("a mask of percent", **none, grey=grey, save=partial(one_by_one, values, percent=True))
    yield good("NIfTI-2, a capital", **none, grey=grey, save=second_nifti)
    for ending in (".nii", ".nii.gz"):
        yield good(f"a misnamed {ending}", **none, grey=grey, save=partial(misnamed, ending))
    yield bad("a NRRD without a frame", **none, grey=grey, save=partial(spaceless, values))
    tight = partial(cropped, values)
    yield good("labels cropped to the bones", **none, grey=grey, save=lambda home: tight(home / "segmentation.nii.gz"))
    negative = values.astype(np.int16)
    negative[:2] = -1024
    yield good("labels with padding below 0", values=negative, head=head, grey=grey)
    yield bad("the scan as labels", values=np.rint(grey).astype(np.int16), head=head, grey=grey)
    yield bad("the labels as scan", values=values, head=head, grey=values.astype(np.float32))
    yield good("a scan of two files", values=values, head=head, save=beside)
    yield good("a series of slices, and a scout", values=values, head=head, save=partial(series, beside=4))
    yield bad("two series", values=values, head=head, save=partial(series, beside=12))
    yield good("a tilted gantry", values=values, head=head, save=tilted)
    yield good("frames of one file", values=values, head=head, save=frames)
    yield bad("missing frames", values=values, head=head, save=partial(frames, left_out=(20, 21)))
    yield good("DICOM-SEG", **none, grey=grey, save=dicom_seg)
    yield bad("missing slices", values=values, head=head, save=partial(series, left_out=(20, 21)))
    for value in (-32768.0, -3024.0, -2000.0, 0.0):
        yield good(f"padding of {value:g}", grey=padded(value))
    for shift in ((0, -2, 0), (3, 0, 0), (0, -4, 2), (0, 0, 6)):
        yield bad(f"a scan that is {shift} voxels off", grey=np.roll(grey, shift, (0, 1, 2)))
    yield bad("a scan of two volumes", values=values, head=head, save=two_volumes)
    for name in ("ct.tif", "ct.nii.gz"):
        yield bad(f"an empty {name}", values=values, head=head, save=lambda home, name=name: (home / name).touch())
    yield bad("no frame", **none, grey=grey, save=frameless)
    island = values.copy()
    skull = np.argwhere(values == 1)
    high = skull[skull[:, 2] > skull[:, 2].max() - 6]
    island[tuple(high[len(high) // 2 : len(high) // 2 + 12].T)] = 3
    yield good("an island of teeth in the skull", values=island)
    swollen = np.where((values == 0) & (grey > -300) & (np.arange(values.shape[2]) < values.shape[2] // 2), 2, values)
    yield bad("a mandible of half the face", values=swollen, repair_limit=100.0)
    places = {"Me": menton, "RCo": top[0], "LCo": top[1]}
    yield good("landmarks", save=partial(marked, **places))
    yield good("landmarks of other names", save=partial(marked, menton=menton, **{"Condylion right": top[0]}))
    yield bad("exchanged sides", save=partial(marked, Me=menton, RCo=top[1], LCo=top[0]))
    yield bad("exchanged landmarks", save=partial(marked, Me=top[0], RCo=menton))
    yield bad("landmarks in another frame", save=partial(marked, frame="RAS", **places))
    for how, size, way in (("1 m off", 1, 1000), ("in cm", 0.1, 0)):
        elsewhere = {name: size * place + way for name, place in places.items()}
        yield bad(f"landmarks {how}", save=partial(marked, **elsewhere))
    lines = ["# CoordinateSystem = 0", "# columns = id,x,y,z,label", *(
        f"{name},{-place[0]},{-place[1]},{place[2]},{name}" for name, place in places.items()
    )]  # fmt: skip
    older = ("\ufeff" + "\r\n".join(lines)).encode()  # as an editor of Windows saves it
    yield good("landmarks of an older Slicer", save=lambda home: (home / "a.fcsv").write_bytes(older))
    yield bad("points without a head", save=lambda home: (home / "a.fcsv").write_text("1,0,0,0"))
    yield bad("markups that are not called so", save=partial(marked, name="landmarks.json", **places))
    region = {"type": "ROI", "center": [0, 0, 0], "size": [400, 400, 400], "insideOut": True}
    yield bad(
        "a region inside out", save=lambda home: (home / "r.mrk.json").write_text(json.dumps({"markups": [region]}))
    )


def surface_beside(values, name: str, folder: Path):
    """Write the label map into a folder with a surface of this name."""
    (folder / "segmentation").mkdir()
    tools.write(folder / "segmentation/P1.nii.gz", values, made()[0])
    pv.Sphere(radius=40).save(folder / "segmentation" / name)


def two_volumes(folder: Path):
    head, _, grey, _ = made()
    image = sitk.JoinSeries([sitk.GetImageFromArray(grey.transpose(2, 1, 0))] * 2)
    sitk.WriteImage(image, str(folder / "ct.nii.gz"))


def frameless(folder: Path):
    head, values, *_ = made()
    plain = tools.write(folder / "segmentation.nii", values, head)
    content = bytearray(plain.read_bytes())
    content[252:256] = bytes(4)
    plain.write_bytes(bytes(content))
