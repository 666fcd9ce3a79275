"""The operations that could bring a wished face, side by side."""

import logging
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations as pairs

import numpy as np

from pinnochio.errors import InputError
from pinnochio.geometry.rigid import RigidMotion
from pinnochio.plans.plan import Plan
from studies.inverse.combinations import LARGEST, Combinations, as_motions, combinations
from studies.inverse.elastic_face import ElasticFace
from studies.inverse.freedom import OPERATIONS, Freedom, freedoms
from studies.inverse.proposal import InverseSettings, Proposal, Search, propose
from studies.inverse.wish import Wish

MOST_PAIRED = 20  # wishes of which every pair is tried


@dataclass(frozen=True)
class Answer:
    """A proposal, what it was free to move, and which combinations of motions the wish cannot tell apart."""

    proposal: Proposal
    freedom: Freedom
    combinations: Combinations

    def moves(self) -> list[tuple[float, bool, dict[str, RigidMotion]]]:
        """Of each combination mm of bone, LARGEST at most, whether the wish cannot tell it, and what so much of it does
        to every segment."""
        known = self.combinations
        shown = np.minimum(known.bone, LARGEST)
        changes = [as_motions(self.freedom, self.proposal.x, change) for change in shown[:, None] * known.directions]
        return list(zip(shown.tolist(), known.hidden.tolist(), changes, strict=True))


def answers(
    face: ElasticFace,
    wish: Wish,
    operations: Sequence[str],
    bounds: Mapping,
    settings: InverseSettings,
    case: str,
    occlusion: Plan | None = None,
) -> dict[str, Answer]:
    """One answer per operation that the patient's segments allow, in their order; InputError where none does."""
    made = {}
    for operation, free in freedoms(face.model, operations, bounds, occlusion).items():
        proposal, search = propose(face, wish, free, case, settings)
        logging.info("%s: %.3f mm after %d corrections", operation, proposal.misfit, proposal.corrections)
        combined = combinations(search, free, wish, proposal.x, settings.tolerance)
        made[operation] = Answer(proposal, free, combined)
    if not made:
        raise InputError(
            case,
            "configuration",
            f"none of {', '.join(operations)} can be done with the segments {', '.join(face.model.segments)}",
            f"name another of {', '.join(OPERATIONS)} in invert.operations, or leave more of invert.bounds open",
        )
    return made


def contradictions(
    face: ElasticFace, wish: Wish, free: Freedom, settings: InverseSettings
) -> list[tuple[str, str, float]]:
    """Pairs of wishes that can each be met alone, within the tolerance `met` to first order, and not together.

    Each with the larger error of the two together, the best way to compromise.
    """
    start, exact = np.zeros(len(free.low)), replace(settings, tolerance=0.0)

    def off(chosen: Wish) -> float:
        search = Search(face, chosen, free, exact)
        field = search.field(search.elastic(start))
        return max(item.error(field) for item in chosen)

    reachable = [item for item in wish if off([item]) <= settings.met] if len(wish) <= MOST_PAIRED else []
    compromises = [(one.name, other.name, off([one, other])) for one, other in pairs(reachable, 2)]
    return [item for item in compromises if item[2] > settings.met]
