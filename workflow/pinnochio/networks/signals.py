"""What the graph networks read of a patient and of a plan, and what they give."""

from dataclasses import dataclass

import torch
from torch import Tensor

from pinnochio.networks.graph import Graph


@dataclass(frozen=True)
class Interface:
    """Interface nodes (i,) of the whole mesh, and their nearest nodes (i, k) of the source body."""

    nodes: Tensor
    neighbours: Tensor


@dataclass(frozen=True)
class LiftTensors:
    """Linear extension of the interface: contact (i,) nodes, smoothing (q, i), departures (3 q, 3 n) per millimetre."""

    contact: Tensor
    smoothing: Tensor
    departures: Tensor


@dataclass(frozen=True)
class TissueGraphs:
    """What the networks need of a patient, whatever the plan.

    Node indices refer to the whole mesh of n nodes. muscle_nodes and superficial_nodes list the nodes of the
    two graphs; bone_moved (b, 1) is 1 on movable segments; cut (n, 1) is 1 on nodes that a cut plane keeps at rest.
    """

    bone: Graph
    bone_moved: Tensor
    muscle: Graph
    muscle_nodes: Tensor
    superficial: Graph
    superficial_nodes: Tensor
    whole: Graph
    bone_muscle: Interface
    bone_superficial: Interface
    muscle_superficial: Interface
    cut: Tensor
    lift: LiftTensors | None = None


@dataclass(frozen=True)
class PlanSignal:
    """A plan: bone (b, 3) mm displacement of the bone surface, cue (n, 3) mm, reliable (n, 1).

    lifted (n, 3) mm: the plan carried through the tissue by the lift; none without one.
    """

    bone: Tensor
    cue: Tensor
    reliable: Tensor
    lifted: Tensor | None = None


@dataclass(frozen=True)
class InterfaceAndVolume:
    """displacement (n, 3) mm; boundary (n, 3) mm, the interface displacement, zero where known (n, 1) is 0."""

    displacement: Tensor
    boundary: Tensor
    known: Tensor


def mirror_signs() -> Tensor:
    """Signs (2, 3) of the coordinates of a patient and of its left-right mirror image."""
    return torch.tensor([[1.0, 1.0, 1.0], [-1.0, 1.0, 1.0]])
