"""Makes what every method of a case is judged by: samples of model and registered scan, with regions."""

import logging

from pinnochio.metrics.judged import choose
from pinnochio.model.patient import PatientModel
from pinnochio.model.postop import PostopSkin
from pinnochio.plans.plan import Plan
from pinnochio.seeds import derive_seed


def choose_samples(case: str, model: str, plan: str, postop: str, samples: int, seed: int, judged: str) -> None:
    """Write about `samples` samples of the scan and of the skin each; InputError where they share no region."""
    target = PostopSkin.read(postop).surface
    chosen = choose(
        PatientModel.read(model), Plan.read(plan, case), *target, samples, derive_seed(seed, "choose_samples", case)
    )
    logging.info("%s: %d samples of the scan, %d of the skin", case, len(chosen.target), len(chosen.skin))
    chosen.write(judged)
