"""The treatment plan of a virtual patient treats that patient."""

import numpy as np
import pytest

from pinnochio.virtual.head import build_head
from pinnochio.virtual.parameters import DEFORMITIES, NORMAL_OVERJET, sample_parameters
from pinnochio.virtual.skeleton import Skeleton
from pinnochio.virtual.treatment import bite_after, treatment_plan


@pytest.mark.parametrize("deformity", DEFORMITIES)
def test_plan_corrects_the_bite(deformity):
    for seed in range(3):
        rng = np.random.default_rng(seed)
        head = build_head(sample_parameters(rng, deformity), spacing=2.5)
        plan = treatment_plan(head, rng, "V01")
        after, p = bite_after(head.parameters, plan), head.parameters
        assert abs(after["overjet"] - NORMAL_OVERJET) < 1.6
        assert abs(after["open_bite"]) < 1.6 and abs(after["midline"]) < 2.2
        if deformity in ("class_ii", "class_iii"):
            assert abs(after["overjet"] - NORMAL_OVERJET) < 0.5 * abs(p.overjet - NORMAL_OVERJET)
        if deformity == "open_bite":
            assert after["open_bite"] < 0.5 * p.open_bite
        assert set(plan.motions) == set(head.segments)


def test_plan_straightens_an_asymmetric_jaw():
    """Chin nearer the midline, and the jaw angles nearer one height, than before."""
    for seed in range(3):
        rng = np.random.default_rng(seed)
        head = build_head(sample_parameters(rng, "asymmetry"), spacing=2.5)
        s = Skeleton(head.parameters)
        move = treatment_plan(head, rng, "V01").motion("mandible_distal")
        assert abs(move.apply(s.pogonion[None])[0, 0]) < 0.6 * abs(s.pogonion[0])
        left, right = (move.apply(s.gonion_of(side)[None])[0, 2] for side in (1.0, -1.0))
        before = s.gonion_of(1.0)[2] - s.gonion_of(-1.0)[2]
        assert abs(left - right) < 0.7 * abs(before)


def test_same_seed_same_plan():
    head = build_head(sample_parameters(np.random.default_rng(0), "class_iii"), spacing=2.5)
    texts = [treatment_plan(head, np.random.default_rng(s), "V").to_json() for s in (1, 1, 2)]
    assert texts[0] == texts[1] != texts[2]
