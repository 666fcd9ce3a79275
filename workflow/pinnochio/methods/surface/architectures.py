"""The surface networks, each with what it reads of a patient and how it is trained."""

from collections.abc import Sequence

import numpy as np
import torch
from torch import Tensor, nn

from pinnochio.methods.surface.losses import chamfer, density, laplacian_change, local_change
from pinnochio.methods.surface.settings import SurfaceSettings
from pinnochio.networks import acmt_net as acmt
from pinnochio.networks import dgcfp
from pinnochio.networks.clouds import FaceGraph, PointCloud, SurfaceInputs, SurfaceStage

MOMENTUM = 0.5, 0.2, 0.01  # of batch normalisation in ACMT-Net: at first, share after which it halves, least [S]


class AcmtArchitecture:
    """ACMT-Net: clouds of face and bone points."""

    bone_shares, bone_radii = acmt.SHARES, acmt.RADII

    def __init__(self, settings: SurfaceSettings):
        self.settings = settings

    def build(self) -> nn.Module:
        """The network, freshly initialised from torch's random state."""
        return acmt.AcmtNet()

    def unit(self, skin: np.ndarray, bone: np.ndarray) -> float:
        """Millimetres that are one inside the network; skin (s, 3), bone (b, 3) mm about the middle of the face."""
        return acmt.UNIT

    def face(
        self, points: np.ndarray, normals: np.ndarray, faces: np.ndarray, rng: np.random.Generator
    ) -> PointCloud | FaceGraph:
        """Some points of the face mesh (p, 3), (f, 3) in units, with coarser levels."""
        return self.cloud(points[some(len(points), self.settings.points, rng)], acmt.SHARES, acmt.RADII, rng)

    def bone(self, points: np.ndarray, rng: np.random.Generator) -> PointCloud:
        """Bone points (b, 3) in units, with coarser levels."""
        return self.cloud(points, self.bone_shares, self.bone_radii, rng)

    def cloud(self, points: np.ndarray, shares, radii, rng: np.random.Generator) -> PointCloud:
        """A point cloud whose levels hold these shares of the settings' points."""
        counts = [max(round(share * self.settings.points), 4) for share in shares]
        return PointCloud.build(points, counts, radii, self.settings.neighbours, rng)

    def loss(self, stages: Sequence[SurfaceStage], pairs: Tensor, seen: Tensor, target: Tensor) -> Tensor:
        """The published loss of a patient: shape, density and local terms.

        pairs (p, 2), seen (n,): see Draw and SurfaceTarget; target (t, 3) in units.
        """
        (stage,) = stages
        moved = stage.rest + stage.displacement
        shape = chamfer(moved, target, seen) + 0.05 * density(moved, target)
        return shape + 5 * local_change(stage.rest, moved, pairs)

    def set_momentum(self, network: nn.Module, share: float) -> None:
        """Batch normalisation: its averages take on less and less of a batch as training goes on."""
        first, every, least = MOMENTUM
        for module in network.modules():
            if isinstance(module, nn.BatchNorm1d):
                module.momentum = max(first * 0.5 ** int(share / every), least)


class FscArchitecture(AcmtArchitecture):
    """FSC-Net: as ACMT-Net, with fewer levels of the bone."""

    bone_shares, bone_radii = acmt.SHARES[: len(acmt.CODE)], acmt.RADII[: len(acmt.CODE)]

    def build(self) -> nn.Module:
        return acmt.FscNet()


class DgcfpArchitecture(AcmtArchitecture):
    """DGCFP: a mesh of the face, in units of the patient's size; momentum as torch has it."""

    bone_shares, bone_radii = dgcfp.SHARES, dgcfp.RADII

    def build(self) -> nn.Module:
        return dgcfp.Dgcfp()

    def unit(self, skin, bone):
        return max(np.linalg.norm(part, axis=1).max() for part in (skin, bone))

    def face(self, points, normals, faces, rng):
        counts = [max(round(self.settings.points * dgcfp.FACE_SHARE**n), 4) for n in range(dgcfp.FACE_LEVELS)]
        return FaceGraph.build(points, normals, faces, counts, dgcfp.FACE_RADII, self.settings.neighbours, rng)

    def loss(self, stages, pairs, seen, target):
        """Shape, density and Laplacian terms at both stages."""
        total = 0.0
        for stage in stages:
            moved = stage.rest + stage.displacement
            if stage.corners is not None:
                seen = torch.cat([seen, seen[stage.corners].amin(1)])
            total += chamfer(moved, target, seen, squared=True) + 0.3 * density(moved, target, squared=True)
            total += 0.05 * laplacian_change(stage.displacement, stage.edges)
        return total

    def set_momentum(self, network, share):
        """Nothing changes."""


ARCHITECTURES = {"acmt": AcmtArchitecture, "fscnet": FscArchitecture, "dgcfp": DgcfpArchitecture}


def architecture(settings: SurfaceSettings) -> AcmtArchitecture:
    """That of the settings."""
    return ARCHITECTURES[settings.architecture](settings)


def build(settings: SurfaceSettings) -> nn.Module:
    """The network of the settings, freshly initialised from torch's random state."""
    return architecture(settings).build()


def run_network(network: nn.Module, settings: SurfaceSettings, inputs: SurfaceInputs) -> list[SurfaceStage]:
    """What the network makes of its inputs, in the precision of the settings.

    On a processor that is single precision: many have no bfloat16 and are six times slower where it is made up.
    """
    on_gpu = inputs.movement.device.type == "cuda"
    with torch.autocast("cuda", torch.bfloat16, enabled=settings.mixed_precision and on_gpu):
        return network(inputs)


def some(size: int, count: int, rng: np.random.Generator) -> np.ndarray:
    """Indices (count,) of so many of `size` things, by lot, each once where there are enough."""
    return rng.choice(size, count, replace=size < count)
