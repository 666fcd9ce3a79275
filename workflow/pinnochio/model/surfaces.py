"""Triangle surfaces of a label map: the bone, segment by segment, and the outer skin."""

import logging
import os
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np
import pyvista as pv
from scipy import ndimage, sparse
from vtkmodules.vtkFiltersCore import vtkFlyingEdges3D, vtkQuadricDecimation

from pinnochio.errors import InputError, damaged
from pinnochio.files import check_seal, replacing, seal
from pinnochio.geometry.surface_integrity import read_mesh
from pinnochio.geometry.triangles import enclosed_volume, vertex_normals
from pinnochio.model.labels import AIR, CRANIUM, segment_code

LOG = logging.getLogger(__name__)
# Gaussian in voxels: 0.7 still keeps a plate of one voxel (0.52 at its centre).
SMOOTHING_VOXELS = (0.7, 0.85, 1.0)
AVERAGED = 16  # rounds over neighbours, which take off steps that are some eight voxels wide [X]
FARTHEST = 0.49  # of a voxel that smoothing may move a point of the skin
SEALED = 1.0  # mm above and below a slit whose sides are taken to touch, as those of sealed lips do [I]
SLIVER = 0.02  # mm between points that are the same where a surface is cut
FINEST = 1.0  # mm; finer voxels are taken together, as many as are no larger: half of the thinnest plate that is kept


@dataclass(frozen=True)
class BoneSurface:
    """Closed surfaces of the bones, one after the other.

    points (b, 3) mm; normals (b, 3) unit, out of the bone; faces (g, 3) int32, outward; segment (b,) int8
    index of the segment, -1 on the cranium; segments: their names, in the order of the indices.
    """

    points: np.ndarray
    normals: np.ndarray
    faces: np.ndarray
    segment: np.ndarray
    segments: tuple[str, ...] = ()

    def part(self, index: int) -> "BoneSurface":
        """The surface of one segment (-1: the cranium); empty if there is none."""
        of_segment = self.segment == index
        renumber = np.cumsum(of_segment) - 1
        faces = renumber[self.faces[of_segment[self.faces[:, 0]]]].astype(np.int32)
        return BoneSurface(
            self.points[of_segment], self.normals[of_segment], faces, self.segment[of_segment], self.segments
        )

    def write(self, path: str | os.PathLike) -> None:
        """Write as VTP: normals and segment as point data, the names as field data."""
        mesh = pv.PolyData.from_regular_faces(self.points, self.faces)
        mesh["normal"], mesh["segment"] = self.normals, self.segment
        mesh.field_data["segments"] = np.array(self.segments, str)
        with replacing(path) as temporary:
            mesh.save(temporary)
            seal(temporary)

    @classmethod
    def read(cls, path: str | os.PathLike) -> "BoneSurface":
        """Read what :meth:`write` wrote."""
        with stored_mesh(path) as mesh:
            faces = mesh.regular_faces.astype(np.int32)
            names = tuple(str(name) for name in mesh.field_data["segments"])
            return cls(
                np.asarray(mesh.points, float), np.asarray(mesh["normal"]), faces, np.asarray(mesh["segment"]), names
            )


def bone_surface(labels, spacing, origin, segments: tuple[str, ...], edge_mm: float = 2.5) -> BoneSurface:
    """Smoothed closed surface of the cranium and of every segment, with edges of about `edge_mm`.

    labels (nx, ny, nz) internal codes [ix, iy, iz]; spacing, origin (3,) mm. A label that is absent gives
    no points. Air-filled cavities inside a bone (marrow that was not labelled) are left out. The same labels
    give the same bytes.
    """
    parts = []
    for index in range(-1, len(segments)):
        code = CRANIUM if index < 0 else segment_code(index)
        box = _bounding_box(labels == code)
        if box is None:
            continue
        inside = labels[box] == code
        inside |= ndimage.binary_fill_holes(inside) & (labels[box] == AIR)
        start = np.asarray(origin) + np.asarray(spacing) * [s.start for s in box]
        points, faces = contour(*_pooled(inside, spacing, start), edge_mm)
        segment = np.full(len(points), index, np.int8)
        parts.append(BoneSurface(points, vertex_normals(points, faces), faces, segment))
    if not parts:
        none = np.zeros((0, 3)), np.zeros((0, 3)), np.zeros((0, 3), np.int32), np.zeros(0, np.int8)
        return BoneSurface(*none, tuple(segments))
    offsets = np.cumsum([0] + [len(part.points) for part in parts[:-1]])
    return BoneSurface(
        np.vstack([part.points for part in parts]),
        np.vstack([part.normals for part in parts]),
        np.vstack([part.faces + offset for part, offset in zip(parts, offsets, strict=True)]).astype(np.int32),
        np.concatenate([part.segment for part in parts]),
        tuple(segments),
    )


def skin_surface(labels, spacing, origin, edge_mm: float = 2.5) -> tuple[np.ndarray, np.ndarray]:
    """Outer skin, the border of the largest piece of the head: points (p, 3) mm, outward faces (f, 3) int32.

    Sealed lips are one surface, without the slit between them. After a Gaussian of one voxel the voxels' steps are
    smoothed away without shrinkage, no point by half a voxel. Open where the head is cut by the border of the volume,
    along a clean line, because the cut is not skin. The same labels give the same bytes.
    """
    pieces, count = ndimage.label(np.asarray(labels) != AIR)
    if count == 0:
        return np.zeros((0, 3)), np.zeros((0, 3), np.int32)
    largest = 1 + int(np.argmax(np.bincount(pieces.ravel())[1:]))
    # The head goes on beyond the cut, so that smoothing does not round the rim off.
    head = np.pad(ndimage.binary_fill_holes(pieces == largest), 4, mode="edge")
    head |= ndimage.binary_closing(head, np.ones((1, 1, 1 + 2 * round(SEALED / spacing[2]))))
    spacing, low = np.asarray(spacing, float), np.asarray(origin, float)
    share, voxel, start = _pooled(head, spacing, low - 4 * spacing)
    skin = _reduced(_without_steps(_isosurface(share, voxel, start, 1.0), voxel), edge_mm)
    high = low + spacing * (np.array(np.shape(labels)) - 1)
    for axis in range(3):
        for side, border in ((-1, low - spacing / 2), (1, high + spacing / 2)):
            skin = skin.clip(side * np.eye(3)[axis], origin=border)
    # Triangles that are hardly any, along the cut, become none.
    skin = skin.triangulate().clean(tolerance=SLIVER, absolute=True)
    faces = skin.regular_faces.astype(np.int32)
    used, faces = np.unique(faces, return_inverse=True)
    return np.asarray(skin.points, float)[used], faces.reshape(-1, 3).astype(np.int32)


def _without_steps(surface: pv.PolyData, spacing) -> pv.PolyData:
    """A contour of voxels without their steps: averaged over neighbours, and what that shrinks put back."""
    points, faces, count = np.asarray(surface.points, float), surface.regular_faces, surface.n_points
    edges = faces.ravel(), np.roll(faces, 1, axis=1).ravel()
    near = sparse.eye(count) + sparse.csr_matrix((np.ones(faces.size), edges), (count, count))
    near += near.T
    neighbours = near.sum(axis=1)

    def averaged(values):
        for _ in range(AVERAGED):
            values = np.asarray(near @ values / neighbours)
        return values

    shift = averaged(points) - points
    # What neighbours share of the shift is shrinkage, what they do not are the steps.
    shift -= averaged(shift)
    size = np.linalg.norm(shift, axis=1, keepdims=True)
    smooth = surface.copy()
    smooth.points = points + shift * np.minimum(1, FARTHEST * min(spacing) / np.maximum(size, 1e-9))
    return smooth


def _pooled(inside, spacing, origin) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Share of the voxels inside, spacing and origin, of blocks of as many voxels as FINEST holds.

    A volume of finer voxels has millions of triangles, of which decimation leaves one in a hundred.
    """
    spacing, origin = np.asarray(spacing, float), np.asarray(origin, float)
    count = np.maximum(np.floor(FINEST / spacing + 1e-6).astype(int), 1)
    if (count == 1).all():
        return inside, spacing, origin
    inside = np.pad(inside, [(0, -size % factor) for size, factor in zip(inside.shape, count, strict=True)])
    blocks = np.zeros([size // factor for size, factor in zip(inside.shape, count, strict=True)], np.float32)
    for offset in np.ndindex(*count):
        blocks += inside[tuple(slice(start, None, factor) for start, factor in zip(offset, count, strict=True))]
    return blocks / np.float32(np.prod(count)), spacing * count, origin + (count - 1) / 2 * spacing


def contour(inside, spacing, origin, edge_mm: float | None = None) -> tuple[np.ndarray, np.ndarray]:
    """Closed surface of a voxel set: points (p, 3) mm, outward faces (f, 3) int32.

    Contoured at the resolution of the volume, so that plates of one voxel survive; quadric decimation then
    brings the edges to about `edge_mm` (None: no decimation). Decimation can tear ragged plates; then the next
    Gaussian is tried, and the attempt with the fewest open edges is kept.
    """
    attempts = []
    for sigma in SMOOTHING_VOXELS:
        surface = _isosurface(inside, spacing, origin, sigma)
        if surface.n_cells:
            # Taubin: takes the voxel steps off without shrinking.
            surface = _reduced(surface.smooth_taubin(n_iter=20, pass_band=0.1), edge_mm)
            attempts.append((surface.n_open_edges, surface))  # counted once, which takes as long as the contour
            if attempts[-1][0] == 0:
                break
    if not attempts:
        return np.zeros((0, 3)), np.zeros((0, 3), np.int32)
    count, best = min(attempts, key=lambda attempt: attempt[0])
    if count:
        LOG.warning("surface of a ragged label keeps %d open edges", count)
    points, faces = np.asarray(best.points, float), best.regular_faces.astype(np.int32)
    if enclosed_volume(points, faces) < 0:
        faces = faces[:, ::-1]
    return points, np.ascontiguousarray(faces)


def _isosurface(inside, spacing, origin, sigma: float) -> pv.PolyData:
    """Contour, at a half, of the share of voxels inside after a Gaussian of `sigma` voxels."""
    pad = 4
    field = ndimage.gaussian_filter(np.pad(np.asarray(inside), pad).astype(np.float32), sigma)
    start = np.asarray(origin, float) - pad * np.asarray(spacing, float)
    image = pv.ImageData(dimensions=field.shape, spacing=spacing, origin=start)
    image["share"] = field.ravel(order="F")
    image.set_active_scalars("share")
    edges = vtkFlyingEdges3D()
    edges.SetInputData(image)
    edges.SetValue(0, 0.5)
    edges.ComputeNormalsOff()
    edges.ComputeScalarsOff()
    edges.Update()
    return pv.wrap(edges.GetOutput())


def _reduced(surface: pv.PolyData, edge_mm: float | None) -> pv.PolyData:
    """Quadric decimation to the face count of equilateral triangles of `edge_mm`."""
    wanted = surface.n_cells if edge_mm is None else max(20, int(surface.area / (np.sqrt(3) / 4 * edge_mm**2)))
    if wanted >= surface.n_cells:
        return surface
    decimate = vtkQuadricDecimation()
    decimate.SetInputData(surface)
    decimate.SetTargetReduction(1 - wanted / surface.n_cells)
    decimate.SetRegularize(True)  # evens out the edge lengths
    decimate.Update()
    return pv.wrap(decimate.GetOutput())


def write_surface(points, faces, path: str | os.PathLike) -> None:
    """Write points (p, 3) mm and faces (f, 3) in the format that the suffix names (VTP, PLY, STL)."""
    with replacing(path) as temporary:
        pv.PolyData.from_regular_faces(np.asarray(points, float), np.asarray(faces)).save(temporary)
        if str(path).endswith(".vtp"):
            seal(temporary)


def read_surface(path: str | os.PathLike) -> tuple[np.ndarray, np.ndarray]:
    """Points (p, 3) float64 mm and faces (f, 3) int32 of a triangle surface."""
    with stored_mesh(path) as mesh:
        mesh = mesh.extract_surface(algorithm="dataset_surface").triangulate()
        return np.asarray(mesh.points, float), mesh.regular_faces.astype(np.int32)


@contextmanager
def stored_mesh(path: str | os.PathLike) -> Iterator[pv.PolyData]:
    """A surface that the study itself has written; InputError where it is damaged or holds something else."""
    try:
        check_seal(path)
        yield read_mesh(path)
    except InputError:
        raise
    except Exception as error:  # VTK and pyvista raise what they like
        raise damaged(path, error) from error


def _bounding_box(mask) -> tuple[slice, ...] | None:
    boxes = ndimage.find_objects(np.asarray(mask).astype(np.uint8))
    return boxes[0] if boxes else None
