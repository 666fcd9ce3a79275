"""Whether a surface file is whole: its length and its indices by its own header.

VTK's readers believe the header. A PLY that is cut off or damaged makes them read memory that is not theirs, which ends
the process, so PLY is read here; a STL that is cut off becomes a surface with a hole.
"""

import os
import re
from codecs import BOM_UTF8
from collections.abc import Iterator, Sequence
from functools import partial
from pathlib import Path

import numpy as np
import pyvista as pv

from pinnochio.errors import Refuse

AGAIN = "export it again, or copy it again from where it comes from"
# Types of PLY by their codes of NumPy.
_NAMES = "i1 char int8, u1 uchar uint8, i2 short int16, u2 ushort uint16, i4 int int32, u4 uint uint32"
_NAMES += ", f4 float float32, f8 double float64"
PLY_TYPES = {name: words.split()[0] for words in _NAMES.split(", ") for name in words.split()[1:]}
STL_HEAD, STL_FACET = 84, 50  # bytes
MOST = 100  # points or faces of a byte of a VTP, which may be compressed


def check_surface(path: str | os.PathLike, refuse: Refuse) -> None:
    """Refuse a STL or VTP file that is cut off, or whose faces name points that it does not hold."""
    damaged = partial(refuse, remedy=AGAIN, file=path)
    content = Path(path).read_bytes()
    {".stl": _check_stl, ".vtp": _check_vtp}[Path(path).suffix.lower()](content, damaged)


def read_mesh(path: str | os.PathLike) -> pv.PolyData:
    """The surface in the file as VTK reads it; RuntimeError for what VTK says of it, and for faces without points."""
    with pv.VtkErrorCatcher(raise_errors=True, send_to_logging=False):
        mesh = pv.read(path)
    if not isinstance(mesh, pv.PolyData):
        raise RuntimeError("it holds no surface")
    for cells in (mesh.GetVerts(), mesh.GetLines(), mesh.GetPolys(), mesh.GetStrips()):
        starts, corners = (pv.convert_array(array) for array in (cells.GetOffsetsArray(), cells.GetConnectivityArray()))
        if (np.diff(starts) < 0).any() or (len(starts) and starts[-1] != len(corners)):
            raise RuntimeError("its faces are no list of corners")
        if len(corners) and not (corners.min() >= 0 and corners.max() < mesh.n_points):
            raise RuntimeError("a face names a point that it does not hold")
    for arrays, count in ((mesh.point_data, mesh.n_points), (mesh.cell_data, mesh.n_cells)):
        if any(len(arrays[name]) != count for name in arrays):
            raise RuntimeError("it has not as many values as points or faces")
    return mesh


def read_obj(path: str | os.PathLike, refuse: Refuse) -> tuple[np.ndarray, np.ndarray]:
    """Points (p, 3) and triangles (f, 3) int32 of an OBJ file, without VTK; its lines and points alone do not count."""
    damaged = partial(refuse, remedy=AGAIN, file=path)
    points, faces = [], []
    counts = dict.fromkeys((b"v", b"vt", b"vn"), 0)  # points, places in a texture, normals: a face may name each
    named = {kind: [] for kind in counts}
    content = Path(path).read_bytes().removeprefix(BOM_UTF8)
    lines = re.sub(rb"\\\r?\n", b" ", content).split(b"\n")
    if lines[-1].strip():
        damaged("its last line does not end, so it may be cut off")
    for line in lines:
        kind, *words = line.split() or [b""]
        try:
            if kind in (b"v", b"f") and (len(words) < 3 or b"_" in line):  # Python reads 1_0 as 10
                raise ValueError
            if kind == b"v":
                points.append([float(word) for word in words][:3])
            counts[kind] = counts.get(kind, 0) + 1
            for word in words if kind == b"f" else ():
                for part, text in zip(named, word.split(b"/"), strict=False):
                    if text or part == b"v":
                        at = int(text)
                        named[part].append(at - 1 if at > 0 else counts[part] + at if at < 0 else -1)
            if kind == b"f":
                faces.append(named[b"v"][-len(words) :])
        except ValueError:
            damaged(f"its line {line[:60]!r} is damaged")
    for part, indices in named.items():
        _check_indices(np.array(indices), counts[part], damaged)
    return np.array(points, float).reshape(-1, 3), _triangles(faces, len(points), damaged)


def read_ply(path: str | os.PathLike, refuse: Refuse) -> tuple[np.ndarray, np.ndarray]:
    """Points (p, 3) and triangles (f, 3) int32 of a PLY file, without VTK; refused where it is damaged."""
    damaged = partial(refuse, remedy=AGAIN, file=path)
    content = Path(path).read_bytes()
    end = re.search(rb"^end_header[ \t]*\r?\n", content[: 2**20], re.MULTILINE)
    if not re.match(rb"ply[ \t]*\r?\n", content) or end is None:
        damaged("it is no PLY file, or its header is cut off")
    form, elements = None, []
    for line in content[: end.start()].decode("latin-1").splitlines()[1:]:
        words = line.split()
        try:
            if words[:1] == ["format"]:
                form = words[1]
            elif words[:1] == ["element"]:
                elements.append((words[1], int(words[2]), []))
            elif words[:2] == ["property", "list"]:
                elements[-1][2].append((words[4], PLY_TYPES[words[3]], PLY_TYPES[words[2]]))
            elif words[:1] == ["property"]:
                elements[-1][2].append((words[2], PLY_TYPES[words[1]], None))
            elif words and words[0] not in ("comment", "obj_info"):
                raise ValueError
        except (IndexError, KeyError, ValueError):
            damaged(f"its header has the line {line[:60]!r}")
    counts = {name: count for name, count, _ in elements}
    if len(counts) < len(elements) or min(counts.values(), default=0) < 0 or not {"vertex", "face"} <= set(counts):
        damaged(f"its header counts {counts}: it needs 'vertex' and 'face', each once")
    for name, _, properties in elements:
        names = [column for column, _, _ in properties]
        lists = {column for column, _, listed in properties if listed}
        if len(set(names)) < len(names) or (name == "vertex" and (lists or not {"x", "y", "z"} <= set(names))):
            damaged(f"its header gives {name!r} the properties {', '.join(names)[:60]}")
        if name == "face" and len({"vertex_indices", "vertex_index"} & lists) != 1:
            damaged("its header lacks vertex_indices of the faces")
    body = content[end.end() :]
    if form == "ascii":
        rows = _text_rows(body, elements, damaged)
    elif form in ("binary_little_endian", "binary_big_endian"):
        rows = _binary_rows(body, elements, "<" if "little" in form else ">", damaged)
    else:
        damaged(f"its format is {form!r}")
    columns = dict(rows)
    points = np.stack([np.asarray(columns["vertex"][axis], float) for axis in "xyz"], axis=1)
    faces = columns["face"].get("vertex_indices", columns["face"].get("vertex_index"))
    return points, _triangles(faces, len(points), damaged)


def _text_rows(body: bytes, elements, damaged) -> Iterator[tuple[str, dict[str, list]]]:
    """Name and columns of each element of a PLY in text: numbers, or arrays of a list's numbers."""
    lines = [line for line in body.split(b"\n") if line.strip()]
    counted = sum(count for _, count, _ in elements)
    if len(lines) != counted or not body.endswith(b"\n"):
        damaged(f"its header counts {counted} vertices and faces, and {len(lines)} whole lines are there")
    place = 0
    for name, count, properties in elements:
        columns = {column: [] for column, _, _ in properties}
        for line in lines[place : place + count]:
            try:
                if b"_" in line:  # which Python reads over
                    raise ValueError
                numbers = [float(word) for word in line.split()]
                at = 0
                for column, _, listed in properties:
                    length = 1
                    if listed is not None:
                        length, at = int(numbers[at]), at + 1
                        if length != numbers[at - 1] or not 0 <= length <= len(numbers) - at:
                            raise ValueError
                    value = numbers[at : at + length]
                    columns[column].append(np.array(value) if listed else value[0])
                    at += length
                if at != len(numbers):
                    raise ValueError
            except (ValueError, IndexError, OverflowError):
                damaged(f"the line {line[:60]!r} is damaged")
        place += count
        yield name, columns


def _binary_rows(body: bytes, elements, order: str, damaged) -> Iterator[tuple[str, dict[str, Sequence]]]:
    """Name and columns of each element of a binary PLY: (n,) numbers, or n arrays of a list's numbers."""

    def numbers(kind: str, count: int, at: int) -> np.ndarray:
        if at + count * np.dtype(kind).itemsize > len(body):
            damaged("its vertices or faces are cut off")
        return np.frombuffer(body, order + kind, count, at)

    place = 0
    for name, count, properties in elements:
        # Mostly every row has lists as long as the first: read at once, else row by row.
        record = []
        for column, kind, listed in properties if count else ():
            if listed is None:
                record.append((column, order + kind))
                continue
            length = int(numbers(listed, 1, place + np.dtype(record).itemsize)[0])
            if not 0 <= length <= len(body):
                damaged(f"a face has {length} corners")
            record += [(f"{column} count", order + listed), (column, order + kind, (length,))]
        size = np.dtype(record).itemsize
        if place + count * size <= len(body):
            rows = np.frombuffer(body, np.dtype(record), count, place)
            lists = [column for column, _, listed in properties if listed and count]
            if all((rows[f"{column} count"] == rows[column].shape[1]).all() for column in lists):
                place += count * size
                yield name, {column: rows[column] if count else np.zeros(0) for column, _, _ in properties}
                continue
        elif not any(listed for _, _, listed in properties):
            damaged("its vertices are cut off")
        columns = {column: [] for column, _, _ in properties}
        for _ in range(count):
            for column, kind, listed in properties:
                length = 1
                if listed is not None:
                    length = int(numbers(listed, 1, place)[0])
                    place += np.dtype(listed).itemsize
                    if not 0 <= length <= len(body):
                        damaged(f"a face has {length} corners")
                values = numbers(kind, length, place)
                columns[column].append(values if listed else values[0])
                place += length * np.dtype(kind).itemsize
        yield name, columns
    if place != len(body):
        damaged(f"its header asks for {place} bytes of vertices and faces, and {len(body)} are there")


def _triangles(faces: Sequence, points: int, damaged) -> np.ndarray:
    """Triangles (f, 3) int32 of the polygons, each a fan round its first corner."""
    if isinstance(faces, np.ndarray) and faces.ndim == 2:
        _check_indices(faces, points, damaged)
        corners = faces.astype(np.int32)
        fans = [corners[:, [0, at, at + 1]] for at in range(1, corners.shape[1] - 1)]
        return np.stack(fans, axis=1).reshape(-1, 3) if fans else np.zeros((0, 3), np.int32)
    fans = []
    for polygon in faces:
        _check_indices(np.asarray(polygon), points, damaged)
        fans += [(polygon[0], polygon[at], polygon[at + 1]) for at in range(1, len(polygon) - 1)]
    return np.array(fans, np.int32).reshape(-1, 3)


def _check_indices(indices: np.ndarray, points: int, damaged) -> None:
    if (indices != np.rint(indices)).any():  # NaN too
        damaged("a face names a point by a number that is not whole")
    if indices.size and not (indices.min() >= 0 and indices.max() < points):
        damaged(f"a face names point {indices.max():g}, and it has {points} points")


def _check_stl(content: bytes, damaged) -> None:
    if len(content) >= STL_HEAD:
        facets = int.from_bytes(content[80:STL_HEAD], "little")
        if len(content) == STL_HEAD + STL_FACET * facets:
            return
    if content.lstrip()[:5].lower() != b"solid" or b"\0" in content:
        damaged("its header and its length disagree: a binary STL has 84 bytes and 50 for each facet")
    if re.search(rb"vertex[^\n]*,", content, re.IGNORECASE):
        damaged("its numbers have decimal commas")
    words = content.lower().split()
    opened, closed, corners = (words.count(word) for word in (b"facet", b"endfacet", b"vertex"))
    if words.count(b"endsolid") < 1 or opened != closed or corners != 3 * opened:
        damaged(f"it is cut off: {opened} facets begin, {closed} end, with {corners} corners")


def _check_vtp(content: bytes, damaged) -> None:
    if b"<VTKFile" not in content[:2000] or not re.search(rb"</VTKFile>\s*(<!--[^<>]*-->\s*)?\Z", content):
        damaged("it is no VTP file, or it is cut off")
    for name, count in re.findall(rb'(NumberOf\w+)="\s*(\d+)', content):
        if int(count) > MOST * len(content):  # VTK reserves the memory
            damaged(f"its header has {name.decode()} {count.decode()[:20]}, more than it can hold")
