"""Contrastive pretraining of ACMT-Net: a reconstruction [I], for the journal's code of it is not public."""

import torch
from torch import Tensor, nn
from torch.nn import functional

from pinnochio.networks.clouds import SurfaceInputs

CLUSTERS, CLUSTER, TEMPERATURE = 64, 16, 0.1


def contrast(network: nn.Module, inputs: SurfaceInputs) -> Tensor:
    """InfoNCE between clusters of face points and the bone under them, mean over the patients.

    A cluster is a drawn face point with its nearest face points, and the bone points nearest to it; the mean features
    of the two shall be alike, and unlike those of all other clusters.
    """
    losses = []
    for number, (face, bone) in enumerate(zip(*network.features(inputs), strict=True)):
        skin, skull = inputs.face.points[inputs.batch == number], inputs.bone.points.view(inputs.count, -1, 3)[number]
        centres = skin[torch.randperm(len(skin), device=skin.device)[:CLUSTERS]]
        codes = []
        for points, features in ((skin, face), (skull, bone)):
            near = torch.cdist(centres, points).topk(CLUSTER, largest=False).indices
            codes.append(functional.normalize(features[near].mean(1), dim=1))
        alike = codes[0] @ codes[1].T / TEMPERATURE
        same = torch.arange(len(centres), device=alike.device)
        losses.append(0.5 * (functional.cross_entropy(alike, same) + functional.cross_entropy(alike.T, same)))
    return torch.stack(losses).mean()
