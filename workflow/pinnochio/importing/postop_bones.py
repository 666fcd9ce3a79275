"""Reads the bones of a post-operative scan, whatever they come as, into one surface in the frame of the file."""

import os
from pathlib import Path

import numpy as np
import trimesh

from pinnochio.errors import InputError
from pinnochio.geometry.closed_surfaces import SURFACE_FORMATS, read_triangles, surface_files
from pinnochio.geometry.triangles import enclosed_volume
from pinnochio.importing.segment_files import read_segments
from pinnochio.importing.segmentation import in_millimetres
from pinnochio.model.surfaces import contour

EDGE = 1.5  # mm; longer edges of a surface file are divided, so that its vertices show it everywhere
PAD = 3  # voxels that bone is continued beyond the border of the volume


def read_postop_bones(path: str | os.PathLike, case: str, bone_points) -> tuple[np.ndarray, np.ndarray]:
    """Points (p, 3) mm and outward faces (f, 3) int32 of all bones of a scan, in its own frame.

    path: a label map (every value but 0 is bone), a surface (PLY, STL, OBJ, VTP), or a folder of surfaces; they may be
    open, and cut by the field of view. bone_points (k, 3) mm: the bone before surgery, for the unit of a surface.
    Raises InputError for what the user must mend.
    """

    def refuse(problem: str, remedy: str, file=path):
        raise InputError(case, file, problem, remedy)

    if not Path(path).is_dir() and not str(path).lower().endswith(SURFACE_FORMATS):
        return _of_labels(path, refuse)
    files = surface_files(path, refuse).values() if Path(path).is_dir() else [path]
    parts, count = [], 0
    for file in files:
        points, faces = read_triangles(file, refuse)
        parts.append((points, _outward(points, faces) + count))
        count += len(points)
    points, faces = (np.concatenate(part) for part in zip(*parts, strict=True))
    points = in_millimetres(points, bone_points, "bone", case, path)
    points, faces = trimesh.remesh.subdivide_to_size(points, faces, EDGE, max_iter=20)
    return points, faces.astype(np.int32)


def _of_labels(path: str | os.PathLike, refuse) -> tuple[np.ndarray, np.ndarray]:
    """The surface of all labels together, open where bone goes on beyond the border of the volume."""
    image, parts = read_segments(path, refuse)
    inside = np.zeros(image.GetSize()[::-1], bool)
    for part in parts:
        inside |= part.voxels()
    inside, spacing = np.pad(inside.transpose(2, 1, 0), PAD, mode="edge"), np.array(image.GetSpacing())
    points, faces = contour(inside, spacing, -PAD * spacing)
    end = spacing * (np.array(image.GetSize()) - 1)
    beyond = ((points < -spacing / 2) | (points > end + spacing / 2)).any(axis=1)
    used, faces = np.unique(faces[~beyond[faces].any(axis=1)], return_inverse=True)
    points = points[used] @ np.reshape(image.GetDirection(), (3, 3)).T + image.GetOrigin()
    faces = faces.reshape(-1, 3).astype(np.int32)
    return points, faces if np.linalg.det(np.reshape(image.GetDirection(), (3, 3))) > 0 else faces[:, ::-1]


def _outward(points: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """The faces, turned round where they look into the bone."""
    return faces if enclosed_volume(points, faces) > 0 else faces[:, ::-1]
