"""DGCFP: dual graph convolutions on the face mesh, attention over the bone and a deformer in two stages.

After the published code (github MyHogsmeade/DGCFP) [S]; docs/explanation/baselines.md says where that is silent and
what was chosen.
"""

from dataclasses import replace

import torch
from torch import Tensor, nn
from torch_geometric.nn import MessagePassing
from torch_geometric.utils import scatter

from pinnochio.networks.acmt_net import bounded
from pinnochio.networks.clouds import FaceGraph, GraphLevel, SurfaceInputs, SurfaceStage
from pinnochio.networks.pointnet import PointNet2, perceptron

SHARES = (1 / 4, 1 / 8, 1 / 16, 1 / 64)  # bone points of each level: 1024, 512, 256 and 64 of 4096 [S]
RADII = (0.1, 0.2, 0.4, 0.8)
DOWN = ((64, 128), (128, 256), (256, 512), (512, 1024))
UP = ((512, 512), (256, 256), (128, 128), (128, 128))
FACE_LEVELS = 5
FACE_SHARE = 1 / 4  # points of a level by those of the finer one [I]
FACE_RADII = (0.1, 0.2, 0.4, 0.8, 0.9)
WIDTH, HIDDEN = 64, 128  # of each of the two streams, and inside their layers
DROP_ABOVE = 10  # edges into a point, of which more are dropped in training by lot


class EdgeConvolution(MessagePassing):
    """torch_geometric's EdgeConv with two layers inside, in its mean; `difference`: of x_j - x_i alone.

    The first layer is linear in both ends of an edge, so it is taken at the points, which are a tenth of the edges: the
    same weights and the same result up to rounding.
    """

    def __init__(self, inputs: int, difference: bool = False):
        super().__init__(aggr="mean")
        self.inputs = 0 if difference else inputs
        self.first = nn.Linear(self.inputs + inputs, HIDDEN)
        self.rest = nn.Sequential(nn.BatchNorm1d(HIDDEN), nn.ReLU(), nn.Linear(HIDDEN, WIDTH), nn.BatchNorm1d(WIDTH))

    def forward(self, values: Tensor, edges: Tensor) -> Tensor:
        """Features (n, 64) from features (n, inputs) and edges (2, e), from j to i."""
        # In full precision, because neighbours differ little.
        with torch.autocast(values.device.type, enabled=False):
            values, weight = values.float(), self.first.weight
            there = values @ weight[:, self.inputs :].T
            here = self.first.bias - there
            if self.inputs:
                here = here + values @ weight[:, : self.inputs].T
        return self.propagate(edges, here=here, there=there)

    def message(self, here_i: Tensor, there_j: Tensor) -> Tensor:
        return self.rest(here_i + there_j)


class DualConv(nn.Module):
    """Two streams side by side, one along the mesh and one in balls: features (n, 128)."""

    def __init__(self, inputs: int, difference: bool = False):
        super().__init__()
        self.mesh, self.ball = EdgeConvolution(inputs, difference), EdgeConvolution(inputs, difference)

    def forward(self, values: Tensor, level: GraphLevel) -> Tensor:
        return torch.cat([self.mesh(values, level.mesh), self.ball(values, level.ball)], 1)


class Propagation(nn.Module):
    """Two steps on one level, the second added to the first."""

    def __init__(self, inputs: int, difference: bool = False):
        super().__init__()
        self.first, self.second = DualConv(inputs, difference), DualConv(2 * WIDTH)

    def forward(self, values: Tensor, level: GraphLevel) -> Tensor:
        values = self.first(values, level)
        return values + self.second(values, level)


class FaceEncoder(nn.Module):
    """A U-shaped graph network on five levels of the face mesh: features (n, 128) from place and normal."""

    def __init__(self):
        super().__init__()
        self.down = nn.ModuleList(Propagation(2 * WIDTH if n else 6, difference=not n) for n in range(FACE_LEVELS))
        self.up = nn.ModuleList(Propagation(4 * WIDTH) for _ in range(FACE_LEVELS - 1))

    def forward(self, face: FaceGraph) -> Tensor:
        levels = [thinned(level) for level in face.levels] if self.training else face.levels
        values, skips = torch.cat([levels[0].points, face.normals], 1), []
        for layer, level in zip(self.down, levels, strict=True):
            if skips:
                values = scatter(values, levels[len(skips) - 1].trace, 0, len(level.points), "mean")
            values = layer(values, level)
            skips.append(values)
        skips.pop()
        for layer, level in zip(self.up, levels[-2::-1], strict=True):
            values = layer(torch.cat([values[level.trace], skips.pop()], 1), level)
        return values


class Dgcfp(nn.Module):
    """The whole system."""

    def __init__(self):
        super().__init__()
        self.face, self.bone = FaceEncoder(), PointNet2(DOWN, UP)
        self.face_code, self.bone_code = perceptron(2 * WIDTH, 64), perceptron(UP[-1][-1], 64)
        self.movement, self.fusion = perceptron(6, 64), perceptron(128, 64)
        self.first = nn.Sequential(perceptron(64, 128, 64), nn.Linear(64, 3))
        self.refined = EdgeConvolution(3 + 64)
        self.second = nn.Sequential(perceptron(64, 128, 64), nn.Linear(64, 3))

    def forward(self, inputs: SurfaceInputs) -> list[SurfaceStage]:
        """Two stages: the face's points, and then these with the middles of drawn triangles among them."""
        face = self.face_code(self.face(inputs.face))
        bone = self.bone_code(self.bone(inputs.bone, inputs.count)).view(inputs.count, -1, 64)
        moved = self.movement(torch.cat([inputs.bone.points, inputs.movement], 1)).view(inputs.count, -1, 64)
        brought = torch.cat([self._attend(face[inputs.batch == n], bone[n], moved[n]) for n in range(inputs.count)])
        values = self.fusion(brought)
        level = inputs.face.levels[0]
        first = SurfaceStage(level.points, bounded(self.first(values)), inputs.batch, level.mesh)
        corners, edges = finer(level, inputs.face.triangles)
        placed, values = first.rest + first.displacement, torch.cat([values, values[corners].mean(1)])
        placed = torch.cat([placed, placed[corners].mean(1)])
        step = bounded(self.second(self.refined(torch.cat([placed, values], 1), edges)))
        rest = torch.cat([first.rest, first.rest[corners].mean(1)])
        batch = torch.cat([inputs.batch, inputs.batch[corners[:, 0]]])
        return [first, SurfaceStage(rest, placed + step - rest, batch, edges, corners)]

    def _attend(self, face: Tensor, bone: Tensor, moved: Tensor) -> Tensor:
        """What each face point (n, 64) takes of the movement code (b, 64): the two halves of the features ask apart."""
        halves = zip(face.split(32, 1), bone.split(32, 1), strict=True)
        return torch.cat([(of_face @ other.T / 8).softmax(1) @ moved for of_face, other in halves], 1)


def thinned(level: GraphLevel) -> GraphLevel:
    """The level with about DROP_ABOVE of the edges into every point that has more, by torch's random state [I]."""

    def some(edges: Tensor) -> Tensor:
        degree = torch.bincount(edges[1], minlength=len(level.points))[edges[1]]
        return edges[:, torch.rand(edges.shape[1], device=edges.device) * degree < DROP_ABOVE]

    return replace(level, mesh=some(level.mesh), ball=some(level.ball))


def finer(level: GraphLevel, triangles: Tensor) -> tuple[Tensor, Tensor]:
    """Half of the triangles (f, 3), drawn from torch's random state, and the edges of the mesh with their middles."""
    corners = triangles[torch.randperm(len(triangles), device=triangles.device)[: len(triangles) // 2]]
    middles = torch.arange(len(corners), device=corners.device).repeat_interleave(3) + len(level.points)
    spokes = torch.stack([corners.flatten(), middles])
    return corners, torch.cat([level.mesh, spokes, spokes.flip(0)], 1)
