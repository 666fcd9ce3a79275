"""Settings of one training phase."""

from collections.abc import Mapping
from dataclasses import dataclass, field


@dataclass(frozen=True)
class TrainingSettings:
    """Plain values of a phase; one step sees one patient under one plan.

    steps: optimisation steps. learning_rate: of AdamW, after a linear warm-up over the share `warmup` of the
    steps, then a cosine to zero. weights: of the physics, data and boundary terms, (1, 2, 1) in the paper
    [S]; the data term is the volumetric error in pretraining, the Chamfer distance in fine-tuning; weight 0
    leaves a term out. physics_ramp: share of the pretraining steps over which the physics weight rises from
    zero, because a raw network violates equilibrium at nu 0.49 so badly that nothing else would be learnt
    [X]; fine-tuning starts at the full weight. clip: largest norm of the gradient. mirror: show each patient
    left-right mirrored half of the time. surface_samples, surface_cutoff (mm): see SurfaceLoss.
    checkpoint_every: steps between the checkpoints that a killed run resumes from.
    """

    steps: int
    learning_rate: float
    weights: Mapping[str, float] = field(default_factory=lambda: {"physics": 1.0, "data": 2.0, "boundary": 1.0})
    warmup: float = 0.05
    physics_ramp: float = 0.5
    weight_decay: float = 1e-3
    clip: float = 1.0
    mirror: bool = True
    surface_samples: int = 4096
    surface_cutoff: float = 15.0
    checkpoint_every: int = 100
