"""Points on skin and bone as the surface networks read them: coarser levels, balls, nearest neighbours, as tensors.

Everything here belongs to the patient's anatomy and is computed once, by k-d trees; the networks then only gather.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, is_dataclass, replace

import numpy as np
import torch
from scipy.spatial import cKDTree
from torch import Tensor

from pinnochio.geometry.scattered import farthest, nearest


@dataclass(frozen=True)
class PointLevel:
    """A coarser level of a point cloud: points (m, 3), each chosen from the n finer ones.

    edges (2, e): from the finer points in the ball around a chosen one to that one; near, weights (n, 3): nearest
    chosen points of each finer one, and their shares.
    """

    points: Tensor
    edges: Tensor
    near: Tensor
    weights: Tensor

    @classmethod
    def join(cls, levels: Sequence["PointLevel"]) -> "PointLevel":
        """The levels of several clouds as one that has no edge between them."""
        coarse, finer = offsets([level.points for level in levels]), offsets([level.near for level in levels])
        rows = zip(levels, coarse, finer, strict=True)
        edges = [level.edges + torch.tensor([[f], [o]], device=level.edges.device) for level, o, f in rows]
        return cls(
            torch.cat([level.points for level in levels]),
            torch.cat(edges, 1),
            torch.cat([level.near + o for level, o in zip(levels, coarse, strict=True)]),
            torch.cat([level.weights for level in levels]),
        )


@dataclass(frozen=True)
class PointCloud:
    """Points (n, 3) with their coarser levels; several of them joined are one cloud too."""

    points: Tensor
    levels: tuple[PointLevel, ...]

    @classmethod
    def build(cls, points: np.ndarray, counts, radii, neighbours: int, rng: np.random.Generator) -> "PointCloud":
        """Levels of `counts` points, each the farthest from those before it, with balls of `radii`.

        At most `neighbours` points of a ball are taken, by lot: those that come first in the published code, where the
        points are in no order.
        """
        levels, finer = [], points
        for count, radius in zip(counts, radii, strict=True):
            chosen = finer[farthest(finer, count)]
            near, weights = nearest(finer, chosen)
            edges = ball_edges(finer, chosen, radius, neighbours, rng)
            levels.append(PointLevel(real(chosen), torch.as_tensor(edges), torch.as_tensor(near), real(weights)))
            finer = chosen
        return cls(real(points), tuple(levels))

    @classmethod
    def join(cls, clouds: Sequence["PointCloud"]) -> "PointCloud":
        """Several clouds as one that has no edge between them."""
        levels = zip(*(cloud.levels for cloud in clouds), strict=True)
        return cls(torch.cat([cloud.points for cloud in clouds]), tuple(PointLevel.join(level) for level in levels))


@dataclass(frozen=True)
class GraphLevel:
    """A level of a triangle mesh: points (m, 3), edges (2, e) along the mesh, (2, b) in balls, both ways.

    trace (m,): the point of the next coarser level that stands for each one; empty on the coarsest.
    """

    points: Tensor
    mesh: Tensor
    ball: Tensor
    trace: Tensor

    @classmethod
    def join(cls, levels: Sequence["GraphLevel"], coarser: Sequence[int]) -> "GraphLevel":
        """The levels of several meshes as one; coarser: points of each one's next level."""
        first, next_level = offsets([level.points for level in levels]), np.cumsum([0, *coarser[:-1]])
        return cls(
            torch.cat([level.points for level in levels]),
            torch.cat([level.mesh + o for level, o in zip(levels, first, strict=True)], 1),
            torch.cat([level.ball + o for level, o in zip(levels, first, strict=True)], 1),
            torch.cat([level.trace + int(o) for level, o in zip(levels, next_level, strict=True)]),
        )


@dataclass(frozen=True)
class FaceGraph:
    """A face mesh with coarser levels: normals (n, 3) and triangles (f, 3) of the finest."""

    levels: tuple[GraphLevel, ...]
    normals: Tensor
    triangles: Tensor

    @property
    def points(self) -> Tensor:
        """Those (n, 3) of the finest level."""
        return self.levels[0].points

    @classmethod
    def build(
        cls, points: np.ndarray, normals: np.ndarray, faces: np.ndarray, counts, radii, neighbours: int,
        rng: np.random.Generator,
    ) -> "FaceGraph":  # fmt: skip
        """Levels of about `counts` points by clustering the vertices of the mesh (p, 3), (f, 3) about seeds.

        The seeds of the finest are drawn, so that every draw is another mesh; those of the coarser ones are spread
        evenly. A cluster's point is the mean of its vertices.
        """
        edges = np.concatenate([faces[:, pair] for pair in ([0, 1], [1, 2], [2, 0])])
        levels, finest = [], None
        for number, (count, radius) in enumerate(zip(counts, radii, strict=True)):
            some = min(count, len(points))
            seeds = farthest(points, some) if number else np.sort(rng.choice(len(points), some, replace=False))
            trace = cKDTree(points[seeds]).query(points)[1]
            used, trace = np.unique(trace, return_inverse=True)
            if finest is None:
                normals = means(normals, trace, len(used))
                normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-9)
                clusters = trace[faces]
                corners = np.sort(clusters, axis=1)
                whole = (corners[:, 0] < corners[:, 1]) & (corners[:, 1] < corners[:, 2])
                finest = real(normals), torch.as_tensor(np.unique(corners[whole], axis=0))
            else:
                levels[-1].append(torch.as_tensor(trace))
            points, edges = means(points, trace, len(used)), trace[edges]
            edges = np.unique(np.sort(edges[edges[:, 0] != edges[:, 1]], axis=1), axis=0)
            around = ball_edges(points, points, radius, neighbours + 1, rng)
            around = around[:, around[0] != around[1]]
            both = np.concatenate([edges, edges[:, ::-1]]).T.copy()
            levels.append([real(points), torch.as_tensor(both), torch.as_tensor(around)])
        levels[-1].append(torch.zeros(0, dtype=torch.int64))
        return cls(tuple(GraphLevel(*level) for level in levels), *finest)

    @classmethod
    def join(cls, graphs: Sequence["FaceGraph"]) -> "FaceGraph":
        """Several faces as one that has no edge between them."""
        sizes = [[len(level.points) for level in graph.levels] + [0] for graph in graphs]
        levels = [
            GraphLevel.join(level, [size[number + 1] for size in sizes])
            for number, level in enumerate(zip(*(graph.levels for graph in graphs), strict=True))
        ]
        first = offsets([graph.levels[0].points for graph in graphs])
        triangles = torch.cat([graph.triangles + o for graph, o in zip(graphs, first, strict=True)])
        return cls(tuple(levels), torch.cat([graph.normals for graph in graphs]), triangles)


@dataclass(frozen=True)
class SurfaceInputs:
    """What a surface network reads of `count` patients, joined, in units.

    face: cloud or mesh of the skin; bone: cloud, as many points of each patient; movement (b, 3) of the bone points;
    batch (n,): the patient of each point of the face.
    """

    face: PointCloud | FaceGraph
    bone: PointCloud
    movement: Tensor
    count: int
    batch: Tensor

    @classmethod
    def join(cls, patients: Sequence["SurfaceInputs"]) -> "SurfaceInputs":
        """Several patients as one that has no edge between them."""
        batch = [torch.full_like(patient.batch, number) for number, patient in enumerate(patients)]
        face, bone = ([getattr(patient, name) for patient in patients] for name in ("face", "bone"))
        moved = torch.cat([patient.movement for patient in patients])
        return cls(face[0].join(face), bone[0].join(bone), moved, len(patients), torch.cat(batch))


@dataclass(frozen=True)
class SurfaceStage:
    """What a surface network gives: where points were (n, 3), and their displacement (n, 3), in units.

    batch (n,): the patient of each. edges (2, e): of the mesh whose corners they are, if there is one. corners (f, 3):
    the last f points were put in the middle of these of the stage before.
    """

    rest: Tensor
    displacement: Tensor
    batch: Tensor
    edges: Tensor | None = None
    corners: Tensor | None = None


def per_patient(stages: Sequence[SurfaceStage], count: int) -> list[list[SurfaceStage]]:
    """The stages of each of `count` joined patients, in numbers of its own."""
    parts = []
    for number in range(count):
        split, before = [], None
        for stage in stages:
            rows = stage.batch == number
            place = torch.cumsum(rows, 0) - 1  # the rows of one patient need not follow each other
            edges = None if stage.edges is None else place[stage.edges[:, rows[stage.edges[0]]]]
            corners = None if stage.corners is None else before[stage.corners[rows[-len(stage.corners) :]]]
            split.append(SurfaceStage(stage.rest[rows], stage.displacement[rows], stage.batch[rows], edges, corners))
            before = place
        parts.append(split)
    return parts


def scaled(value, factor: Tensor):
    """Any of the classes above with its places, normals and movements times a factor (3,)."""
    return _changed(
        value, lambda name, tensor: tensor * factor if name in ("points", "normals", "movement") else tensor
    )


def to_device(value, device: torch.device | str):
    """Any of the classes above on another device."""
    return _changed(value, lambda name, tensor: tensor.to(device))


def _changed(value, change: Callable[[str, Tensor], Tensor], name: str = ""):
    if isinstance(value, Tensor):
        return change(name, value)
    if isinstance(value, tuple):
        return tuple(_changed(part, change) for part in value)
    if not is_dataclass(value):
        return value
    return replace(
        value, **{item.name: _changed(getattr(value, item.name), change, item.name) for item in fields(value)}
    )


def ball_edges(points, centres, radius: float, most: int, rng: np.random.Generator) -> np.ndarray:
    """Edges (2, e) from points (n, 3) to centres (m, 3) nearer than `radius`, at most so many into each, by lot."""
    inside = cKDTree(points).query_ball_point(centres, radius, return_sorted=True)
    inside = [np.asarray(near) if len(near) <= most else rng.choice(near, most, replace=False) for near in inside]
    return np.stack([np.concatenate(inside), np.repeat(np.arange(len(centres)), [len(near) for near in inside])])


def means(values: np.ndarray, group: np.ndarray, count: int) -> np.ndarray:
    """Mean (count, c) of the values (n, c) of each group."""
    size = np.bincount(group, minlength=count)
    return np.stack([np.bincount(group, column, count) for column in values.T], axis=1) / size[:, None]


def offsets(parts: Sequence[Tensor]) -> list[int]:
    """Rows before each part where they are put one under the other."""
    return np.cumsum([0, *(len(part) for part in parts[:-1])]).tolist()


def real(values) -> Tensor:
    """As a float32 tensor."""
    return torch.as_tensor(np.ascontiguousarray(values), dtype=torch.float32)
