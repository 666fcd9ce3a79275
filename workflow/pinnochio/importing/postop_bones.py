"""Reads the bones of a post-operative scan, whatever they come as, into one surface in the frame of the file."""

import os
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from pinnochio.errors import refusal
from pinnochio.geometry.closed_surfaces import SURFACE_FORMATS, read_triangles, surface_files
from pinnochio.geometry.triangles import enclosed_volume
from pinnochio.importing.head_parts import bone_parts
from pinnochio.importing.segment_files import Segment, read_segments
from pinnochio.importing.segmentation import in_millimetres
from pinnochio.model.labels import TISSUES
from pinnochio.model.surfaces import contour
from pinnochio.volume_size import is_image

EDGE = 1.5  # mm; longer edges of a surface file are divided, so that its vertices show it everywhere
MOST = 5e6  # triangles that the division may make: some ten million take minutes and the memory of the stage
PAD = 3  # voxels that bone is continued beyond the border of the volume


def read_postop_bones(
    path: str | os.PathLike, case: str, bone_points, label_values: Mapping | str | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """Points (p, 3) mm and outward faces (f, 3) int32 of all bones of a scan, in its own frame.

    path: a label map, a surface (PLY, STL, OBJ, VTP), or a folder of surfaces; they may be open, and cut by the field
    of view. label_values: values by structure, or the name of the tool that wrote the map (then a folder of images will
    do as well); without them, and of a map in which they name no bone or that has one value, every value is bone.
    bone_points (k, 3) mm: the bone before surgery, for the unit of a surface.
    Raises InputError for what the user must mend.
    """
    refuse = refusal(case, path)
    image, parts = None, []
    if not Path(path).is_dir() and not str(path).lower().endswith(SURFACE_FORMATS):
        image, parts = read_segments(path, refuse)
    if isinstance(label_values, str) and is_image(path) and len(parts) != 1:
        return _joined(
            [_surface(image, inside, refuse) for image, inside in bone_parts(path, label_values, refuse)], refuse
        )
    if image is not None:
        inside = np.zeros(image.GetSize()[::-1], bool)
        named = isinstance(label_values, Mapping) and any(_named_bone(part, label_values) for part in parts)
        for part in parts:
            if not named or len(parts) == 1 or is_bone(part, label_values):
                inside |= part.voxels()
        if not inside.any():
            refuse("it shows no bone", "label the bones, or correct 'labels'")
        return _surface(image, inside, refuse)
    files = surface_files(path, refuse).values() if Path(path).is_dir() else [path]
    read = (read_triangles(file, refuse) for file in files)
    import trimesh  # half a second, which a plan given as motions is spared

    outward = [(points, faces if enclosed_volume(points, faces) > 0 else faces[:, ::-1]) for points, faces in read]
    points, faces = _joined(outward, refuse)
    points = in_millimetres(points, bone_points, "bone", case, path)
    longest = np.linalg.norm(points[faces] - points[np.roll(faces, 1, axis=1)], axis=2).max(axis=1)
    # A triangle becomes four until no edge is too long.
    divided = float((4.0 ** np.ceil(np.log2(longest[longest > EDGE] / EDGE))).sum())
    if not divided <= MOST:
        problem = f"its edges are up to {longest.max():.3g} mm long; divided it would have {divided:.2g} triangles"
        refuse(problem, "remove points that stand off, or remesh it with edges of a few mm")
    points, faces = trimesh.remesh.subdivide_to_size(points, faces, EDGE, max_iter=20)
    return points, faces.astype(np.int32)


def _named_bone(part: Segment, label_values: Mapping) -> bool:
    """Whether the labels name a segment as a bone."""
    values = [value for name, value in label_values.items() if name not in (*TISSUES, "left_out")]
    return part.value in values or part.name in values


def is_bone(part: Segment, label_values: Mapping) -> bool:
    """Whether a segment is neither soft tissue nor left out, by the configuration's labels."""
    others = [label_values.get(name) for name in TISSUES] + list(label_values.get("left_out", ()))
    return not {part.name, part.value} & {key for key in others if key is not None}


def _joined(surfaces, refuse) -> tuple[np.ndarray, np.ndarray]:
    """Surfaces as one."""
    if not surfaces:
        refuse("it shows no bone", "give the bones after surgery")
    starts = np.cumsum([0] + [len(points) for points, _ in surfaces[:-1]])
    points = np.concatenate([points for points, _ in surfaces])
    return points, np.concatenate([faces + start for (_, faces), start in zip(surfaces, starts, strict=True)])


def _surface(image, inside, refuse) -> tuple[np.ndarray, np.ndarray]:
    """The surface of bone (bool [iz, iy, ix]), open where it goes on beyond the border of the volume."""
    inside, spacing = np.pad(inside.transpose(2, 1, 0), PAD, mode="edge"), np.array(image.GetSpacing())
    points, faces = contour(inside, spacing, -PAD * spacing)
    end = spacing * (np.array(image.GetSize()) - 1)
    beyond = ((points < -spacing / 2) | (points > end + spacing / 2)).any(axis=1)
    used, faces = np.unique(faces[~beyond[faces].any(axis=1)], return_inverse=True)
    if not len(faces):
        refuse("its bone has no surface: it fills the volume, or hardly any voxel", "label the bones alone")
    points = points[used] @ np.reshape(image.GetDirection(), (3, 3)).T + image.GetOrigin()
    faces = faces.reshape(-1, 3).astype(np.int32)
    return points, faces if np.linalg.det(np.reshape(image.GetDirection(), (3, 3))) > 0 else faces[:, ::-1]
