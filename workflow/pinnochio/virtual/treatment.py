"""The plan that treats a virtual patient's own deformity."""

import numpy as np

from pinnochio.anatomy.labels import segment_code
from pinnochio.anatomy.plan import Plan
from pinnochio.anatomy.plan_sampling import JawAnatomy, compose_plan, motion, sample_maxilla, truncated
from pinnochio.virtual.head import Head
from pinnochio.virtual.parameters import NORMAL_OVERJET, REST_GAP, HeadParameters
from pinnochio.virtual.skeleton import Skeleton


def jaw_anatomy(head: Head) -> JawAnatomy:
    """Reference points of the segments, from the voxels of the head."""
    points, segment = [], []
    for index in range(len(head.segments)):
        own = np.argwhere(head.labels == segment_code(index)) * head.spacing + head.origin
        points.append(own)
        segment.append(np.full(len(own), index))
    return JawAnatomy.from_points(np.concatenate(points), np.concatenate(segment), head.segments)


def treatment_plan(head: Head, rng: np.random.Generator, case: str) -> Plan:
    """Bimaxillary plan that brings the patient's overjet, open bite, midline and cant close to normal.

    The maxilla's motion is drawn as usual for the deformity, with small turns and midline shift only;
    the bite is corrected to a residue of 0.5 mm (SD) per direction [I].
    """
    p, s = head.parameters, Skeleton(head.parameters)
    upper, lower = s.upper_incisor, s.lower_incisor
    anatomy = jaw_anatomy(head)
    maxilla = sample_maxilla(rng, p.deformity, anatomy.centre["lefort1"], spread=0.3)
    residue = np.array([truncated(rng, 0, 0.5, -1, 1) for _ in range(3)])
    goal = upper + [0, NORMAL_OVERJET, -REST_GAP]
    shift = (goal - lower) * [1, -1, 1] + residue
    molar = s.molar_y - lower[1]
    pitch = -np.degrees(np.arctan(p.open_bite / molar))
    roll = -np.degrees(np.arctan(p.occlusal_cant / s.gonion[0]))
    yaw = -np.degrees(np.arctan(p.chin_deviation / (s.condyle[1] - s.pogonion[1])))
    return compose_plan(rng, case, anatomy, maxilla, motion((pitch, 0.7 * roll, 0.7 * yaw), shift, lower))


def bite_after(parameters: HeadParameters, plan: Plan) -> dict[str, float]:
    """Overjet, open bite and midline (mm) once the plan is carried out, measured at the incisor edges."""
    s = Skeleton(parameters)
    upper = plan.motion("lefort1").apply(s.upper_incisor[None])[0]
    lower = plan.motion("mandible_distal").apply(s.lower_incisor[None])[0]
    gap = lower - upper
    return {"overjet": gap[1], "open_bite": -gap[2] - REST_GAP, "midline": gap[0]}
