"""ACMT-Net and FSC-Net: point networks that read the face, the bone and how the bone moves.

After the published code (Fang et al. 2022, 2024; github RPIDIAL/Facial_Simulation) [S];
docs/explanation/baselines.md says where that is silent and what was chosen.
"""

import torch
from torch import Tensor, nn

from pinnochio.networks.clouds import SurfaceInputs, SurfaceStage
from pinnochio.networks.pointnet import PointNet2, perceptron

UNIT = 250.0  # mm: the length that is one inside these networks [I]
REACH = 0.5  # largest component of a displacement, in units
SHARES = (1 / 4, 3 / 32, 1 / 32)  # points of each level by those of the cloud: 1024, 384 and 128 of 4096 [S]
RADII = (0.1, 0.2, 0.4)
DOWN = ((64, 64, 128), (128, 128, 256), (256, 256, 512))
WHOLE = (512, 512, 1024)
UP = ((512, 512), (512, 256), (256, 128), (128, 128, 128))
CODE, CODE_WHOLE = ((64, 64, 128), (128, 128, 128)), (128, 128, 128)  # FSC-Net's bone encoder


class AcmtNet(nn.Module):
    """Encoders of face and bone, attention of each face point over the bone, and the movement that it brings along.

    The attention is the product of the features by the number of bone points, without a softmax, which the published
    code has commented out.
    """

    def __init__(self):
        super().__init__()
        self.face, self.bone = PointNet2(DOWN, UP, WHOLE), PointNet2(DOWN, UP, WHOLE)
        self.face_features, self.bone_features = perceptron(UP[-1][-1], 64), perceptron(UP[-1][-1], 64)
        self.movement = perceptron(6, 64)
        self.displacement = nn.Linear(64, 3)

    def features(self, inputs: SurfaceInputs) -> tuple[Tensor, Tensor]:
        """Features of the face and of the bone points, (count, n, 64) and (count, b, 64)."""
        face = self.face_features(self.face(inputs.face, inputs.count))
        bone = self.bone_features(self.bone(inputs.bone, inputs.count))
        return face.view(inputs.count, -1, 64), bone.view(inputs.count, -1, 64)

    def forward(self, inputs: SurfaceInputs) -> list[SurfaceStage]:
        """The displacement of every face point."""
        face, bone = self.features(inputs)
        alike = face @ bone.transpose(1, 2)
        moved = self.movement(torch.cat([inputs.bone.points, inputs.movement], 1))
        brought = (alike / bone.shape[1] @ moved.view(inputs.count, -1, 64)).flatten(0, 1)
        return [SurfaceStage(inputs.face.points, bounded(self.displacement(brought)), inputs.batch)]


class FscNet(nn.Module):
    """One code of the whole bone and its movement, which every face point reads."""

    def __init__(self):
        super().__init__()
        self.face = PointNet2(DOWN, UP, WHOLE)
        self.attention = SelfAttention(UP[-1][-1])
        self.bone = PointNet2(CODE, (), CODE_WHOLE, inputs=6)
        self.displacement = nn.Sequential(perceptron(UP[-1][-1] + CODE_WHOLE[-1], 128, 64), nn.Linear(64, 3))

    def forward(self, inputs: SurfaceInputs) -> list[SurfaceStage]:
        """As :meth:`AcmtNet.forward`."""
        face = self.face(inputs.face, inputs.count)
        face = self.attention(face.view(inputs.count, -1, face.shape[1])).flatten(0, 1)
        code = self.bone(inputs.bone, inputs.count, torch.cat([inputs.bone.points, inputs.movement], 1))
        raw = self.displacement(torch.cat([face, code[inputs.batch]], 1))
        return [SurfaceStage(inputs.face.points, bounded(raw), inputs.batch)]


class SelfAttention(nn.Module):
    """Every point looks at all points of its patient and takes on what it finds there, (count, n, width) [I]."""

    def __init__(self, width: int):
        super().__init__()
        self.query, self.key, self.value = nn.Linear(width, 64), nn.Linear(width, 64), nn.Linear(width, width)

    def forward(self, features: Tensor) -> Tensor:
        weights = (self.query(features) @ self.key(features).transpose(1, 2) / 8).softmax(2)
        return features + weights @ self.value(features)


def bounded(raw: Tensor) -> Tensor:
    """Displacement in units within REACH, in full precision."""
    return 2 * REACH * (torch.sigmoid(raw.float()) - 0.5)
