"""Settings of one training phase."""

from collections.abc import Mapping
from dataclasses import dataclass

PATIENTS_IN_MEMORY = 200  # 7 GB
PHASES = {"pretrain": "pretraining", "finetune": "finetuning"}  # of a training, and the section of its settings


@dataclass(frozen=True)
class TrainingSettings:
    """Plain values of a phase; one step sees `batch` patients, each under one plan. A default of 0 is for a phase whose
    loss has no such term; where it has, the configuration says it.

    steps: optimisation steps. learning_rate: of AdamW (averages of its gradients by `beta1` and `beta2`), after a
    linear warm-up over the share `warmup` of the steps, then a cosine to zero, or, where `decay` is not 0, that factor
    again and again, each share `decay_every` of the steps, down to `decay_floor` of the full rate. muon: multiple of it
    at which matrices take orthogonal steps (:mod:`pinnochio.training.muon`), 0 for none. weights: of the
    physics, data and boundary terms, (1, 2, 1) in the paper [S]; the data term is the volumetric error in pretraining,
    the Chamfer distance in fine-tuning; weight 0 leaves a term out. clip: largest norm of the gradient. mirror: show
    each patient left-right mirrored half of the time. surface_samples, surface_cutoff (mm): see SurfaceLoss.

    physics_ramp: share of the steps over which the physics weight rises from zero, because a raw network
    violates equilibrium at nu 0.49 so badly that nothing else would be learnt [X].

    sources: in fine-tuning, learn what the network leaves of the post-operative skins as loads on the tissue
    (:mod:`pinnochio.methods.sources`); not in the paper.

    validation: patients of the fold that are not trained on (never more than a quarter of them), by whose data
    term the weights are chosen; 0 takes the last weights. The paper says nothing of it. One is enough to tell
    the states of one run apart, since all are compared on the same patient, and costs 3 % of 32 [I].
    validate_every: steps between two looks at it. No look ends a training, because with a cosine schedule much of the
    gain comes last.
    patients_in_memory: of more, patients are read while others are shown (:mod:`pinnochio.training.streaming`).
    checkpoint_every (steps), checkpoint_seconds: after either, what a killed run resumes from is written.
    """

    steps: int
    learning_rate: float
    batch: int
    beta1: float
    beta2: float
    decay: float
    decay_every: float
    decay_floor: float
    weights: Mapping[str, float]
    warmup: float
    weight_decay: float
    clip: float
    mirror: bool
    validation: int
    validate_every: int
    muon: float = 0.0
    physics_ramp: float = 0.0
    sources: bool = False
    surface_samples: int = 0
    surface_cutoff: float = 0.0
    patients_in_memory: int = PATIENTS_IN_MEMORY
    checkpoint_every: int = 100
    checkpoint_seconds: float = 60.0
