"""Virtual heads as free tools would segment them: their label maps, the scan that they saw."""

import gzip
import json

import numpy as np
import SimpleITK as sitk
from scipy import ndimage

from pinnochio.geometry.rigid import RigidMotion
from pinnochio.importing.occlusion import _beside
from pinnochio.importing.segmentation import read_labels
from pinnochio.model.labels import CRANIUM
from pinnochio.model.surfaces import bone_surface, write_surface
from pinnochio.virtual.head import Head
from tests.helpers.coarse_head import IMPORTED, import_head
from tests.helpers.settings import CONFIG

SCANNER = RigidMotion.from_degrees((100, 40, -60), (20, 300, -50), (0, 0, 0))
SEGMENTS = ("lefort1", "mandible_distal", "proximal_left", "proximal_right", "mandible", "chin")


def structures(head: Head) -> dict[str, np.ndarray]:
    """Skull, mandible, teeth (a block on each jaw), canal and tissue of a virtual head, (nx, ny, nz) bool each."""
    labels = head.labels
    codes = {name: 11 + index for index, name in enumerate(head.segments)}
    upper = labels == codes["lefort1"]
    lower = np.isin(labels, [code for name, code in codes.items() if name != "lefort1"])
    low, high = (np.argwhere(mask)[:, 2] for mask in (upper, labels == codes["mandible_distal"]))
    edge = int(0.5 * (low.min() + high.max()))
    height = max(2, round(18 / head.spacing[2]))
    level = np.arange(labels.shape[2])
    body = labels == codes["mandible_distal"]
    made = {
        "skull": upper | (labels == CRANIUM),
        "mandible": lower,
        "upper_teeth": upper & (level < edge + height),
        "lower_teeth": body & (level > edge - height),
        "muscle": labels == 2,
        "tissue": labels > 0,
    }
    made["skull"] &= ~made["upper_teeth"]
    made["mandible"] &= ~made["lower_teeth"]
    made["canal"] = ndimage.binary_erosion(made["mandible"], iterations=1) & (level < edge - height)
    return made


def dental(head: Head) -> np.ndarray:
    """Label map as DentalSegmentator writes it."""
    masks = structures(head)
    values = np.zeros(head.labels.shape, np.uint8)
    for value, name in enumerate(("skull", "mandible", "upper_teeth", "lower_teeth", "canal"), 1):
        values[masks[name]] = value
    return values


def scan(head: Head, air=-1000.0, tissue=40.0, bone=900.0, noise=40.0) -> np.ndarray:
    """Grey values of a CT of the head: all of it inside the skin, teeth as bone, a little blurred, with noise."""
    masks = structures(head)
    grey = np.where(masks["tissue"], tissue, air)
    for name in ("skull", "mandible", "upper_teeth", "lower_teeth"):
        grey[masks[name]] = bone
    grey = ndimage.gaussian_filter(grey, 0.5) + np.random.default_rng(0).normal(0, noise, grey.shape)
    return grey.astype(np.float32)


def arches(head: Head, motion: RigidMotion) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Points and faces of both arches, 14 mm deep, the lower one moved by `motion`, in a scanner's frame with noise."""
    bone = bone_surface(head.labels, head.spacing, head.origin, head.segments, 0.8)
    rng, made = np.random.default_rng(1), {}
    jaws = {"upper": bone.part(0), "lower": bone.part(1)}
    for (name, jaw), other in zip(jaws.items(), reversed(jaws.values()), strict=True):
        points, faces = _beside(jaw.points, jaw.faces, other.points, 14.0)
        closed = motion.apply(points) if name == "lower" else points
        made[name] = SCANNER.apply(closed) + rng.normal(0, 0.05, points.shape), faces
    return made


def save_arches(folder, scans, names=("upper", "lower")):
    """Write the arches as STL under these names; the folder."""
    folder.mkdir(exist_ok=True)
    for name, (points, faces) in zip(names, scans.values(), strict=False):
        write_surface(points, faces, folder / f"{name}.stl")
    return folder


def write(path, values, head: Head | None, direction=None, spacing=None, origin=None):
    """Write values (nx, ny, nz) on the head's grid, or with this header."""
    image = sitk.GetImageFromArray(np.ascontiguousarray(np.asarray(values).transpose(2, 1, 0)))
    image.SetSpacing([float(size) for size in (head.spacing if spacing is None else spacing)])
    image.SetOrigin([float(start) for start in (head.origin if origin is None else origin)])
    if direction is not None:
        image.SetDirection(np.ravel(np.asarray(direction, float)).tolist())
    sitk.WriteImage(image, str(path))
    return path


def write_seg_nrrd(path, layers, segments, direction, spacing, origin):
    """As 3D Slicer writes it. layers: arrays [ix, iy, iz]; segments: (name, value, layer)."""

    def vector(numbers):
        return "(" + ",".join(repr(float(number)) for number in numbers) + ")"

    many = len(layers) > 1
    sizes = [len(layers)] * many + list(layers[0].shape)
    head = [
        "NRRD0004",
        "# Complete NRRD file format specification at:",
        "# http://teem.sourceforge.net/nrrd/format.html",
        "type: unsigned char",
        f"dimension: {len(sizes)}",
        "space: left-posterior-superior",
        f"sizes: {' '.join(map(str, sizes))}",
        "space directions: " + "none " * many + " ".join(map(vector, (direction * spacing).T)),
        "kinds: " + "list " * many + "domain domain domain",
        "encoding: gzip",
        f"space origin: {vector(origin)}",
    ]
    for number, (name, value, layer) in enumerate(segments):
        key = f"Segment{number}_"
        head += [
            f"{key}ID:=Segment_{number}",
            f"{key}LabelValue:={value}",
            f"{key}Layer:={layer}",
            f"{key}Name:={name}",
        ]
    data = np.stack(layers).astype(np.uint8).tobytes(order="F")
    path.write_bytes("\n".join(head).encode() + b"\n\n" + gzip.compress(data, 1))


def points(path, frame="LPS", **places):
    """Write places (3,) mm, LPS, as points of a markup in this frame."""
    turn = np.ones(3) if frame == "LPS" else np.array([-1, -1, 1])
    listed = [{"label": name, "position": (turn * place).tolist()} for name, place in places.items()]
    markup = {"type": "Fiducial", "coordinateSystem": frame, "coordinateUnits": "mm", "controlPoints": listed}
    path.write_text(json.dumps({"markups": [markup]}))
    return path


def plane(path, name, point, normal, how="normal"):
    """Write a plane as a markup: with its normal, or with the matrix of its axes; or by the name of its file alone, as
    3D Slicer does ("slicer"), before 4.13 by three "points"."""
    normal = np.asarray(normal, float) / np.linalg.norm(normal)
    markup = {"type": "Plane", "name": name, "coordinateSystem": "LPS", "coordinateUnits": "mm"}
    markup["controlPoints"] = [{"label": name, "position": list(map(float, point))}]
    if how in ("slicer", "points"):  # as of a plane that was first called otherwise
        del markup["name"]
        path = path.with_name(f"{name}.mrk.json")
        across = np.cross(normal, [1, 0, 0])
        places = [point, point + 9 * across, point + 9 * np.cross(normal, across)][: 1 if how == "slicer" else 3]
        markup["controlPoints"] = [
            {"label": f"temp-{number}", "position": np.asarray(place, float).tolist(), "positionStatus": "defined"}
            for number, place in enumerate(places, 1)
        ]
    if how in ("normal", "slicer"):
        markup |= {"center": list(map(float, point)), "normal": normal.tolist(), "size": [90.0, 90.0, 0.0]}
    elif how == "matrix":
        one = np.cross(normal, [0.3, 0.5, 0.8])
        one /= np.linalg.norm(one)
        axes = np.eye(4)
        axes[:3, :3] = np.column_stack([one, np.cross(normal, one), normal])
        markup["baseToNode"] = axes.ravel().tolist()
    path.write_text(json.dumps({"markups": [markup]}))
    return path


def run(
    folder, segmentation, preset="dentalsegmentator", volume=None, cuts=("lefort1", "split"), markups=(), **settings
):
    """Import what a tool segmented; returns the report and the labels."""
    outputs = {name: str(folder / "out" / file) for name, file in IMPORTED.items()}
    usual = {"segments": SEGMENTS, "orientation": "header", "unlabelled_muscle": "derived"}
    usual |= {"repair_limit": CONFIG["repair"]["limit"], "volume": volume, "cuts": cuts}
    usual |= {"markups": [str(markup) for markup in markups]} | settings
    import_head(case="P1", segmentation=str(segmentation), label_values=preset, outputs=outputs, **usual)
    return json.loads((folder / "out/report.json").read_text()), read_labels(outputs["labels"])
