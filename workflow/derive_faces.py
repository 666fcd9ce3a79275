"""Makes the compact face model of the virtual cohort from the ICT-FaceKit model: own region, frame and basis.

`python workflow/derive_faces.py model.npz` writes `workflow/pinnochio/virtual/face_model/faces.npz`; the same input
gives the same bytes. What it holds stands in README.md beside it.
"""

import argparse
import zipfile
from io import BytesIO
from pathlib import Path

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from pinnochio.code import LIBRARY
from pinnochio.files import replacing
from pinnochio.geometry.triangles import vertex_areas

TARGET = LIBRARY / "virtual" / "face_model" / "faces.npz"
FACE, HEAD = 9409, 11248  # vertices of the face, and of face, head and neck together
EYES = ((21451, 23021), (23021, 24591))  # vertices of the left and right eyeball
TRAGION, ORBITALE = (77.0, 24.0, 10.0), (27.0, 17.0, 88.0)  # on the mean face, model's axes, mm [I]
BACK, LOW, HIGH = 25.0, -175.0, 105.0  # mm: how far the kept skin reaches behind the tragi, down and up
VARIANCE = 0.98  # of the face's variance that the kept modes have
STEP = 0.004  # mm: resolution of a mode at one standard deviation
STAMP = (1980, 1, 1, 0, 0, 0)


def derive(source: Path, target: Path) -> None:
    """Write the compact model."""
    model = np.load(source)
    mean = model["mean_mm"].astype(float)
    modes = model["modes"].astype(float) * model["modes_scale_mm"].astype(float)[:, None, None]
    every = model["triangles"].astype(int)
    corners = model["landmarks68"].astype(int)

    tragi, turn = frankfort()
    sides = np.array(TRAGION) * [[1, 1, 1], [-1, 1, 1]]

    mean, modes = _axes(mean - tragi) @ turn.T, _axes(modes) @ turn.T
    skin = every[(every < HEAD).all(axis=1)]
    keep = (mean[:, 1] < BACK) & (mean[:, 2] > LOW) & (mean[:, 2] < HIGH)
    lids_and_mouth = rims(skin, mean)
    skin = skin[keep[skin].all(axis=1)]
    used = np.unique(skin)
    place = np.full(len(mean), -1)
    place[used] = np.arange(len(used))

    # Every further point is a mean of vertices, so that it moves with the identity as they do.
    groups = [used[i : i + 1] for i in range(len(used))]
    triangles = [place[skin]]
    for rim in lids_and_mouth:
        ring = place[rim]
        triangles.append(np.column_stack([ring, np.full(len(ring), len(groups))]))
        groups.append(np.unique(rim))
    triangles = np.vstack(triangles)
    names = {"eyes": [], "upper_teeth": [], "lower_teeth": [], "upper_edges": [], "lower_edges": []}
    for start, end in EYES:
        names["eyes"].append(len(groups))
        groups.append(np.arange(start, end))
    for row, teeth in zip(("upper", "lower"), tooth_rows(every, mean), strict=True):
        for edge, labial in teeth:
            names[f"{row}_edges"].append(len(groups))
            groups.append(edge)
            names[f"{row}_teeth"].append(len(groups))
            groups.append(labial)
    points = np.array([mean[group].mean(axis=0) for group in groups])
    fields = np.stack([modes[:, group].mean(axis=1) for group in groups], axis=1)

    front = (points[: len(used), 1] < 0)[:, None] * vertex_areas(points, triangles)[: len(used), None]
    modes, weights = basis(fields, np.repeat(np.sqrt(front), 3, axis=1).ravel(), len(used))
    eyeball = np.mean([np.linalg.norm(mean[a:b] - mean[a:b].mean(axis=0), axis=1).mean() for a, b in EYES])
    largest = np.abs(modes).max(axis=(1, 2))
    scales = np.full(len(modes), STEP)
    assert (largest / STEP < 32767).all()
    arrays = {
        "mean": points.astype(np.float32),
        "modes": np.round(modes / scales[:, None, None]).astype(np.int16),
        "scales": scales.astype(np.float32),
        "share": weights.astype(np.float32),
        "triangles": triangles.astype(np.uint16),
        "landmarks68": place[corners].astype(np.int32),
        "tragi": np.array([place[nearest(mean[:HEAD], at)] for at in _axes(sides - tragi) @ turn.T], np.int32),
        "eye_radius": np.float32(eyeball),
        **{name: np.array(index, np.int32) for name, index in names.items()},
    }
    with replacing(target) as temporary, zipfile.ZipFile(temporary, "w", zipfile.ZIP_DEFLATED, compresslevel=9) as file:
        for name, values in arrays.items():
            buffer = BytesIO()
            np.lib.format.write_array(buffer, np.asarray(values))
            file.writestr(zipfile.ZipInfo(f"{name}.npy", STAMP), buffer.getvalue(), zipfile.ZIP_DEFLATED)
    print(f"{len(used)} vertices, {len(points)} points, {len(modes)} modes, {Path(target).stat().st_size / 1e6:.2f} MB")


def _axes(vectors: np.ndarray) -> np.ndarray:
    """From the model's axes (x left, y up, z forward) to LPS."""
    return np.stack([vectors[..., 0], -vectors[..., 2], vectors[..., 1]], axis=-1)


def frankfort() -> tuple[np.ndarray, np.ndarray]:
    """Middle of the tragi in the model's axes, and the rotation (3, 3) that lays the Frankfort plane level in LPS."""
    tragi = np.array(TRAGION) * [0, 1, 1]
    ahead = _axes(np.array(ORBITALE) * [0, 1, 1] - tragi)
    angle = np.arctan2(ahead[2], -ahead[1])
    cos, sin = np.cos(angle), np.sin(angle)
    return tragi, np.array([[1, 0, 0], [0, cos, -sin], [0, sin, cos]])


def nearest(points: np.ndarray, place: np.ndarray) -> int:
    return int(((points - place) ** 2).sum(axis=1).argmin())


def rims(triangles: np.ndarray, points: np.ndarray) -> list[np.ndarray]:
    """Directed edges (r, 2) of the rims of both eyes and of the mouth, as a triangle that closes them needs them."""
    edges = triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2)
    _, inverse, count = np.unique(np.sort(edges, axis=1), axis=0, return_inverse=True, return_counts=True)
    open_ = edges[count[inverse] == 1][:, ::-1]
    index, local = np.unique(open_, return_inverse=True)
    local = local.reshape(-1, 2)
    graph = coo_array((np.ones(len(local)), (local[:, 0], local[:, 1])), shape=(len(index),) * 2)
    _, piece = connected_components(graph, directed=False)
    loops = [open_[piece[local[:, 0]] == i] for i in range(piece.max() + 1)]
    return [loop for loop in loops if points[loop, 1].max() < 0]


def tooth_rows(triangles: np.ndarray, points: np.ndarray) -> list[list[tuple[np.ndarray, np.ndarray]]]:
    """Of the upper and of the lower teeth, left to right: vertices of the biting edge and of the outer face."""
    teeth = triangles[(triangles >= 17039).all(axis=1) & (triangles < 21451).all(axis=1)]
    graph = coo_array(
        (np.ones(len(teeth) * 2), (teeth[:, :2].T.ravel(), teeth[:, 1:].T.ravel())), shape=(len(points),) * 2
    )
    _, piece = connected_components(graph, directed=False)
    teeth = [np.flatnonzero(piece == label) for label in np.unique(piece[17039:21451])]
    teeth = sorted(teeth, key=lambda tooth: tooth[0])
    rows = []
    for row, up in ((teeth[:16], 1.0), (teeth[16:], -1.0)):
        parts = []
        for tooth in row:
            height = points[tooth, 2] * up
            edge = tooth[np.argsort(height, kind="stable")[:6]]
            crown = tooth[height < height.min() + 5]
            away = np.hypot(points[crown, 0], points[crown, 1] - points[teeth[0], 1].mean())
            parts.append((edge, crown[np.argsort(-away, kind="stable")[:4]]))
        rows.append(sorted(parts, key=lambda part: -points[part[0], 0].mean()))
    return rows


def basis(fields: np.ndarray, weight: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Own modes (k, n, 3) mm per standard deviation, by weighted principal components over the first `count` points.

    They have at least VARIANCE of the variance there; also the share (k,) that each has of it.
    """
    flat = fields[:, :count].reshape(len(fields), -1) * weight
    left, size, _ = np.linalg.svd(flat @ flat.T)
    share = size / size.sum()
    kept = int(np.searchsorted(np.cumsum(share), VARIANCE)) + 1
    turned = left[:, :kept]
    turned = turned * np.sign(turned[np.abs(turned).argmax(axis=0), np.arange(kept)])
    return np.einsum("mk,mnx->knx", turned, fields), share[:kept]


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("model", type=Path, help="model.npz of ICT-FaceKit: mean, modes, triangles, landmarks")
    parser.add_argument("--target", type=Path, default=TARGET, help="file to write")
    arguments = parser.parse_args()
    derive(arguments.model, arguments.target)
