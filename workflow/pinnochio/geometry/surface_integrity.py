"""Whether a surface file is whole: its length and its indices by its own header, before VTK reads it.

VTK's readers believe the header. A PLY that is cut off or damaged makes them read memory that is not theirs, which ends
the process; a STL that is cut off becomes a surface with a hole.
"""

import os
import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pyvista as pv

Refuse = Callable[..., None]  # refuse(problem, remedy, file=...) raises InputError
AGAIN = "export it again, or copy it again from where it comes from"
# Types of PLY by their codes of NumPy.
PLY_TYPES = {
    **{name: code for code, names in {"i1": "char int8", "u1": "uchar uint8"}.items() for name in names.split()},
    **{name: code for code, names in {"i2": "short int16", "u2": "ushort uint16"}.items() for name in names.split()},
    **{name: code for code, names in {"i4": "int int32", "u4": "uint uint32"}.items() for name in names.split()},
    **{name: code for code, names in {"f4": "float float32", "f8": "double float64"}.items() for name in names.split()},
}
STL_HEAD, STL_FACET = 84, 50  # bytes


def check_surface(path: str | os.PathLike, refuse: Refuse) -> None:
    """Refuse a PLY, STL, OBJ or VTP file that is cut off, or whose faces name points that it does not hold."""

    def damaged(problem: str):
        refuse(problem, AGAIN, file=path)

    content = Path(path).read_bytes()
    {".ply": _check_ply, ".stl": _check_stl, ".obj": _check_obj, ".vtp": _check_vtp}[Path(path).suffix.lower()](
        content, damaged
    )


def read_mesh(path: str | os.PathLike) -> pv.PolyData:
    """The surface in the file as VTK reads it; RuntimeError for what VTK says of it, and for faces without points."""
    with pv.VtkErrorCatcher(raise_errors=True, send_to_logging=False):
        mesh = pv.read(path)
    if not isinstance(mesh, pv.PolyData):
        raise RuntimeError("it holds no surface")
    for cells in (mesh.GetVerts(), mesh.GetLines(), mesh.GetPolys(), mesh.GetStrips()):
        starts, corners = (pv.convert_array(own) for own in (cells.GetOffsetsArray(), cells.GetConnectivityArray()))
        if (np.diff(starts) < 0).any() or (len(starts) and starts[-1] != len(corners)):
            raise RuntimeError("its faces are no list of corners")
        if len(corners) and not (corners.min() >= 0 and corners.max() < mesh.n_points):
            raise RuntimeError("a face names a point that it does not hold")
    for arrays, count in ((mesh.point_data, mesh.n_points), (mesh.cell_data, mesh.n_cells)):
        if any(len(arrays[name]) != count for name in arrays):
            raise RuntimeError("it has not as many values as points or faces")
    return mesh


def _check_ply(content: bytes, damaged) -> None:
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
    named = {name: [own for own, _, _ in properties] for name, _, properties in elements}
    if not {"x", "y", "z"} <= set(named["vertex"]) or not {"vertex_indices", "vertex_index"} & set(named["face"]):
        damaged("its header lacks x, y, z of the vertices or vertex_indices of the faces")
    body = content[end.end() :]
    if form == "ascii":
        _check_ply_text(body, elements, counts, damaged)
    elif form in ("binary_little_endian", "binary_big_endian"):
        _check_ply_binary(body, elements, counts, "<" if "little" in form else ">", damaged)
    else:
        damaged(f"its format is {form!r}")


def _check_ply_text(body: bytes, elements, counts, damaged) -> None:
    lines = [line for line in body.split(b"\n") if line.strip()]
    if len(lines) != sum(counts.values()) or not body.endswith(b"\n"):
        damaged(f"its header counts {sum(counts.values())} vertices and faces, and {len(lines)} whole lines are there")
    place = 0
    for name, count, properties in elements:
        for line in lines[place : place + count]:
            try:
                numbers = [float(word) for word in line.split()]
            except ValueError:
                damaged(f"{line[:60]!r} is no line of numbers")
            at = 0
            for own, _, listed in properties:
                length = 1
                if listed is not None:
                    length = int(numbers[at]) if at < len(numbers) and 0 <= numbers[at] < 2**31 else -1
                    at += 1
                    if length < 0 or at + length > len(numbers):
                        damaged(f"the line {line[:60]!r} is cut off")
                    if name == "face" and own.startswith("vertex_ind"):
                        _check_indices(np.array(numbers[at : at + length]), counts["vertex"], damaged)
                at += length
            if at != len(numbers):
                damaged(f"the line {line[:60]!r} has {len(numbers)} numbers, not {at}")
        place += count


def _check_ply_binary(body: bytes, elements, counts, order: str, damaged) -> None:
    place = 0
    for name, count, properties in elements:
        if count == 0:
            continue
        if not any(listed for _, _, listed in properties):
            place += count * sum(np.dtype(kind).itemsize for _, kind, _ in properties)
            continue
        # Mostly every face has as many corners as the first: read at once, else face by face.
        record, lengths = [], []
        for number, (_, kind, listed) in enumerate(properties):
            if listed is None:
                record.append((f"v{number}", order + kind))
                continue
            before = np.dtype(record).itemsize
            if place + before + np.dtype(listed).itemsize > len(body):
                damaged("its faces are cut off")
            length = int(np.frombuffer(body, order + listed, 1, place + before)[0])
            if not 0 <= length <= len(body):
                damaged(f"its first face has {length} corners")
            record += [(f"n{number}", order + listed), (f"v{number}", order + kind, (length,))]
            lengths.append((f"n{number}", length))
        size = np.dtype(record).itemsize
        if place + count * size <= len(body):
            rows = np.frombuffer(body, np.dtype(record), count, place)
            if all((rows[key] == length).all() for key, length in lengths):
                for number, (own, _, listed) in enumerate(properties):
                    if name == "face" and listed and own.startswith("vertex_ind"):
                        _check_indices(rows[f"v{number}"], counts["vertex"], damaged)
                place += count * size
                continue
        for _ in range(count):
            for own, kind, listed in properties:
                length = 1
                if listed is not None:
                    if place + np.dtype(listed).itemsize > len(body):
                        damaged("its faces are cut off")
                    length = int(np.frombuffer(body, order + listed, 1, place)[0])
                    place += np.dtype(listed).itemsize
                if length < 0 or place + length * np.dtype(kind).itemsize > len(body):
                    damaged("its faces are cut off")
                if name == "face" and listed and own.startswith("vertex_ind"):
                    _check_indices(np.frombuffer(body, order + kind, length, place), counts["vertex"], damaged)
                place += length * np.dtype(kind).itemsize
    if place != len(body):
        damaged(f"its header asks for {place} bytes of vertices and faces, and {len(body)} are there")


def _check_indices(indices: np.ndarray, points: int, damaged) -> None:
    if indices.size and not (indices.min() >= 0 and indices.max() < points):
        damaged(f"a face names point {indices.max():g}, and it has {points} points")


def _check_stl(content: bytes, damaged) -> None:
    if len(content) >= STL_HEAD:
        facets = int.from_bytes(content[80:STL_HEAD], "little")
        if len(content) == STL_HEAD + STL_FACET * facets:
            return
    if content.lstrip()[:5].lower() != b"solid" or b"\0" in content:
        damaged("its header and its length disagree: a binary STL has 84 bytes and 50 for each facet")
    words = content.lower().split()
    opened, closed, corners = (words.count(word) for word in (b"facet", b"endfacet", b"vertex"))
    if words.count(b"endsolid") < 1 or opened != closed or corners != 3 * opened:
        damaged(f"it is cut off: {opened} facets begin, {closed} end, with {corners} corners")


def _check_obj(content: bytes, damaged) -> None:
    points, at = 0, []
    lines = content.split(b"\n")
    if lines[-1].strip():
        damaged("its last line does not end, so it may be cut off")
    for line in lines:
        words = line.split()
        try:
            if words[:1] == [b"v"]:
                points += 1
                if len([float(word) for word in words[1:]]) < 3:
                    raise ValueError
            elif words[:1] == [b"f"]:
                corners = [int(word.split(b"/")[0]) for word in words[1:]]
                if len(corners) < 3:
                    raise ValueError
                at += [corner - 1 if corner > 0 else points + corner if corner < 0 else -1 for corner in corners]
        except ValueError:
            damaged(f"its line {line[:60]!r} is damaged")
    _check_indices(np.array(at), points, damaged)


def _check_vtp(content: bytes, damaged) -> None:
    if b"<VTKFile" not in content[:2000] or not re.search(rb"</VTKFile>\s*(<!--[^<>]*-->\s*)?\Z", content):
        damaged("it is no VTP file, or it is cut off")
