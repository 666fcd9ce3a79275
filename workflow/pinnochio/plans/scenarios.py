"""The parts of a plan that are operations of their own."""

import numpy as np

from pinnochio.geometry.rigid import RigidMotion
from pinnochio.plans.plan import Plan
from pinnochio.plans.roles import UNCUT, role
from pinnochio.plans.sampling import CHIN_ADVANCE

LEAST_ADVANCE = 1.0  # mm; a chin that is brought forward by less is not operated on alone [I]


def parts(plan: Plan, chin_centre: np.ndarray | None = None) -> dict[str, Plan]:
    """Plans by name: lefort1, mandible (with rami and chin), genioplasty and bimaxillary, as far as the plan has them.

    An uncut mandible turns with the maxilla.

    genioplasty is the chin's motion against the mandible; where that is below LEAST_ADVANCE, the mean advance of
    practice. chin_centre (3,) mm, needed for it.
    """
    roles = {name: role(name) for name in plan.motions}
    upper = [name for name, what in roles.items() if what == "maxilla"]
    lower = [name for name, what in roles.items() if what not in ("maxilla", UNCUT)]
    if UNCUT in roles:
        upper, lower = [*upper, UNCUT, *lower], []
    jaws = {"lefort1": upper, "mandible": lower}
    plans = {name: Plan(plan.case, {key: plan.motions[key] for key in names}) for name, names in jaws.items() if names}
    chins = [name for name, what in roles.items() if what == "chin"]
    distal = [name for name, what in roles.items() if what in ("distal", UNCUT)]
    if chins and distal and chin_centre is not None:
        chin, jaw = plan.motions[chins[0]], plan.motions[distal[0]]
        shift = chin.apply(jaw.inverse(chin_centre[None]))[0] - chin_centre
        motion = RigidMotion(chin.rotation @ jaw.rotation.T, shift, chin_centre)
        if np.linalg.norm(shift) < LEAST_ADVANCE:
            motion = RigidMotion(translation=np.array([0.0, -CHIN_ADVANCE[0], 0.0]))
        plans["genioplasty"] = Plan(plan.case, {chins[0]: motion})
    if upper and lower:
        plans["bimaxillary"] = plan
    return plans
