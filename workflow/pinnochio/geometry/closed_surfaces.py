"""Triangle surfaces that users bring: read with checks, and closed ones, one per structure, turned into voxels."""

import os
from collections.abc import Iterator, Sequence
from functools import partial
from pathlib import Path

import numpy as np
import pyvista as pv
import SimpleITK as sitk

from pinnochio.errors import InputError, Refuse
from pinnochio.files import entries
from pinnochio.geometry.mesh_topology import pieces
from pinnochio.geometry.surface_integrity import check_surface, read_mesh, read_obj, read_ply
from pinnochio.geometry.triangles import enclosed_volume, face_normals

SURFACE_FORMATS = (".ply", ".stl", ".obj", ".vtp")
UNREAD = (".vtk", ".off", ".3mf", ".glb", ".gltf", ".wrl", ".amf")  # .vtk: as 3D Slicer saves models by itself
SPACING = 1.0  # mm; half the thinnest plate of bone that the later stages keep
MARGIN = 15  # voxels of air round the head where it is whole, more than the edge of a lattice cell
CUT_AREA, CUT_FLATNESS = 1000.0, 0.2  # mm2, mm: so much skin so flat at an end of the head is a cut, as at the neck
FLAT, NARROW, TORN = 1.0, 45.0, 0.1  # mm off a plane, mm across; share of the edges that are open: no surface [I]
Surface = tuple[np.ndarray, np.ndarray]


def surfaces_in(folder: str | os.PathLike, refuse: Refuse | None = None) -> list[Path]:
    """The surface files of a folder by name; none where the path is no folder. One of UNREAD is refused by `refuse`."""
    files = entries(folder)
    if refuse and (unread := [file for file in files if file.suffix.lower() in UNREAD]):
        refuse("such surfaces are not read", f"save it as one of {', '.join(SURFACE_FORMATS)}", file=unread[0])
    return [file for file in files if file.suffix.lower() in SURFACE_FORMATS]


def surface_files(folder: str | os.PathLike, refuse: Refuse) -> dict[str, Path]:
    """The surface files of a folder by their stem, the name of the structure."""
    files: dict[str, Path] = {}
    for file in surfaces_in(folder, refuse):
        if file.stem in files:
            refuse(f"{file.stem!r} has two surfaces", "keep one file per structure", file=file)
        files[file.stem] = file
    if not files:
        refuse("the folder holds no surface", f"save one surface per structure as {', '.join(SURFACE_FORMATS)}")
    return files


def read_triangles(path: str | os.PathLike, refuse: Refuse) -> tuple[np.ndarray, np.ndarray]:
    """Points (p, 3) and faces (f, 3) int32 of a surface file as they stand in it, equal points made one."""
    if not Path(path).is_file():
        refuse("the file does not exist", "correct the path in the cohort table", file=path)
    if not str(path).lower().endswith(SURFACE_FORMATS):
        refuse("this is no surface format known here", f"save it as one of {', '.join(SURFACE_FORMATS)}", file=path)
    try:
        if str(path).lower().endswith((".ply", ".obj")):
            points, faces = (read_ply if str(path).lower().endswith(".ply") else read_obj)(path, refuse)
        else:
            check_surface(path, refuse)
            mesh = read_mesh(path)
            if mesh.n_cells:
                mesh = mesh.extract_surface(algorithm="dataset_surface").triangulate()
            points, faces = np.asarray(mesh.points, float), mesh.regular_faces.astype(np.int32)
    except InputError:
        raise
    except Exception as error:  # the readers raise what they like
        refuse(f"it cannot be read as a surface ({error})", "export the surface again", file=path)
    if not np.isfinite(points).all():
        refuse("it holds coordinates that are not finite", "remove these vertices and export again", file=path)
    if len(faces):
        points, faces = _merged(points, faces)
    if len(faces) == 0:
        refuse("the surface is empty", "export the structure as triangles", file=path)
    return points, faces


def read_closed_surface(path, direction, refuse: Refuse) -> tuple[np.ndarray, np.ndarray, list[dict]]:
    """A surface in LPS mm, closed as by :func:`closed_openings`, and the planes that close it.

    direction (3, 3) turns the file's axes into LPS; None trusts the file: LPS, or RAS where 3D Slicer says so.
    """
    points, faces = read_triangles(path, refuse)
    if direction is None:
        with open(path, "rb") as file:
            direction = np.diag([-1.0, -1.0, 1.0] if b"SPACE=RAS" in file.read(2000) else [1.0, 1.0, 1.0])
    return closed_openings(points @ np.asarray(direction).T, faces, partial(refuse, file=path))


def closed_openings(points, faces, refuse: Refuse) -> tuple[np.ndarray, np.ndarray, list[dict]]:
    """The surface (LPS mm) with its openings closed, and the planes that close the wide ones: place, normal, size.

    An opening that is flat or narrow, as where a scan ends or of an eye, is closed in its plane; the rim of a face in a
    plane at its hindmost point, up to which the surface is drawn backwards.
    """
    edges = faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2)
    _, first, count = np.unique(np.sort(edges, axis=1), axis=0, return_index=True, return_counts=True)
    rim, planes = edges[first[count % 2 == 1]], []
    if len(rim) > TORN * len(count):
        refuse(f"{len(rim)} of its {len(count)} edges are open", "export it as one surface, cut at its ends")
    opening = pieces(rim, len(points))[rim[:, 0]]
    for one in np.unique(opening):
        ends = rim[opening == one]
        places = points[np.unique(ends)]
        centre, size = places.mean(axis=0), float(np.ptp(places, axis=0).max())
        normal = np.linalg.eigh(np.cov(places.T))[1][:, 0]
        if size > NARROW and np.percentile(np.abs((places - centre) @ normal), 90) > FLAT:
            normal, centre[1] = np.array([0.0, 1.0, 0.0]), places[:, 1].max()
            used, here = np.unique(ends, return_inverse=True)
            behind = len(points) + here.reshape(ends.shape)
            points = np.vstack([points, points[used] * [1, 0, 1] + [0, centre[1], 0]])
            walls = np.column_stack([ends[:, ::-1], behind[:, 0]]), np.column_stack([ends[:, 1], behind])
            faces, ends = np.vstack([faces, *walls]), behind
        fan = np.column_stack([ends[:, ::-1], np.full(len(ends), len(points))])
        points, faces = np.vstack([points, centre]), np.vstack([faces, fan])
        if size > NARROW:
            planes.append({"place": centre.round(1).tolist(), "normal": normal.round(3).tolist(), "size": size})
    return points, faces, planes


def voxelised(surfaces: Sequence[Surface], head: bool = True) -> tuple[sitk.Image, Iterator[np.ndarray]]:
    """Grid of SPACING round closed surfaces (points mm, faces), and the voxels (bool [iz, iy, ix]) inside each.

    The first surface is the outer skin. The grid has a margin of air, but ends at the head where the skin ends in a
    flat cut across an axis: there the head goes on, as at the border of a scan. Not of a head, but of pieces of one, it
    is as small as can be.
    """
    skin = surfaces[0][0]
    points = np.concatenate([vertices for vertices, _ in surfaces])
    cut_low, cut_high = _cuts(*surfaces[0]) if head else np.zeros((2, 3), bool)
    margin = MARGIN if head else 1
    low = np.where(cut_low, skin.min(axis=0) + SPACING / 2, points.min(axis=0) - margin * SPACING)
    high = np.where(cut_high, skin.max(axis=0) - SPACING / 2, points.max(axis=0) + margin * SPACING)
    size = np.maximum(np.floor((high - low) / SPACING + 1e-6).astype(int) + 1, 1)
    low = np.where(cut_high & ~cut_low, high - (size - 1) * SPACING, low)
    grid = sitk.Image(size.tolist(), sitk.sitkUInt8)
    grid.SetSpacing([SPACING] * 3)
    grid.SetOrigin(low.tolist())
    return grid, (_inside(*surface, low, size) for surface in surfaces)


def _cuts(points, faces) -> tuple[np.ndarray, np.ndarray]:
    """Whether the surface ends in a flat cut at the low and at the high end of each axis, (3,) bool each."""
    corners, area = points[faces], face_normals(points, faces)[1]
    at_low = (corners < points.min(axis=0) + CUT_FLATNESS).all(axis=1)
    at_high = (corners > points.max(axis=0) - CUT_FLATNESS).all(axis=1)
    return area @ at_low > CUT_AREA, area @ at_high > CUT_AREA


def _inside(points, faces, low, size) -> np.ndarray:
    """Voxels inside, bool [iz, iy, ix].

    Each connected sheet counts with the sign of its volume, so that teeth may overlap the jaw that holds them in one
    file, and a cavity, whose sheet looks inward, stays hollow.
    """
    sheet_of = pieces(faces, len(points))
    turns = np.zeros(size[::-1], np.int16)
    outward = np.sign(enclosed_volume(points, faces)) or 1
    for sheet in range(sheet_of.max() + 1):
        used, renumbered = np.unique(faces[sheet_of[faces[:, 0]] == sheet], return_inverse=True)
        part, triangles = points[used], renumbered.reshape(-1, 3)
        start = np.clip(np.floor((part.min(axis=0) - low) / SPACING).astype(int) - 1, 0, size)
        stop = np.clip(np.ceil((part.max(axis=0) - low) / SPACING).astype(int) + 2, 0, size)
        if (stop <= start).any():
            continue
        box = pv.ImageData(dimensions=stop - start, spacing=[SPACING] * 3, origin=low + start * SPACING)
        mask = pv.PolyData.from_regular_faces(part, triangles).voxelize_binary_mask(reference_volume=box)["mask"]
        here = tuple(slice(a, b) for a, b in zip(start[::-1], stop[::-1], strict=True))
        turns[here] += mask.reshape((stop - start)[::-1]).astype(np.int16) * np.int16(
            outward * np.sign(enclosed_volume(part, triangles))
        )
    return turns > 0


def _merged(points, faces) -> tuple[np.ndarray, np.ndarray]:
    """Equal points made one (STL and many scanners repeat the corners of each triangle); no degenerate face."""
    points, renumber = np.unique(points, axis=0, return_inverse=True)
    faces = renumber.ravel()[faces]
    proper = (faces != np.roll(faces, 1, axis=1)).all(axis=1)
    used, faces = np.unique(faces[proper], return_inverse=True)
    return points[used], faces.reshape(-1, 3).astype(np.int32)
