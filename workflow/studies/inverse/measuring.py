"""How well the motion is found that made a face: simulated faces, scans of outcomes, and their landmarks."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from pinnochio.geometry.closest_points import closest_points
from pinnochio.geometry.rigid import RigidMotion
from pinnochio.model.bones import segment_points
from pinnochio.model.patient import PatientModel
from pinnochio.model.regions import NAMES, regions
from pinnochio.plans.plan import Plan
from studies.inverse.alternatives import Answer
from studies.inverse.combinations import combinations
from studies.inverse.elastic_face import ElasticFace
from studies.inverse.freedom import LPS, OPERATIONS, Freedom, freedom
from studies.inverse.proposal import InverseSettings, propose
from studies.inverse.wish import Marks, PlaceWish, SurfaceWish, Wish

# What was wished: the finite-element face of the plan; the scanned outcome; the places of its landmarks.
SIMULATED, OUTCOME, LANDMARKS = TASKS = ("simulated", "outcome", "landmarks")
EXACT = 0.002  # mm: tolerance of a search for the motion that made a simulated face, which is exact


def widest(model: PatientModel, bounds) -> tuple[str, Freedom]:
    """The operation that moves most of what the patient's segments allow, and its freedom."""
    free = {name: freedom(model, name, bounds) for name in OPERATIONS}
    known = {name: part for name, part in free.items() if part is not None}
    name = max(known, key=lambda part: len(known[part].low))
    return name, known[name]


def sought(
    face: ElasticFace, wish: Wish, operation: str, free: Freedom, settings: InverseSettings, tolerance: float, case: str
) -> Answer:
    """The answer to a wish by one operation, sought with a tolerance (mm) of its own."""
    proposal, search = propose(face, wish, free, operation, case, replace(settings, tolerance=tolerance))
    return Answer(proposal, free, combinations(search, free, wish, proposal.x, settings.tolerance))


def motion_rows(answer: Answer, reference: Plan) -> list[dict]:
    """By segment of the answer: how far its motion is from that of the reference, in all and in what the wish tells.

    error: mean distance, mm, of the segment's bone under the two; degrees: angle between their rotations. told: the
    same of the difference without the combinations that the wish cannot tell. moved: mean motion of the reference.
    """
    part = answer.freedom
    x = part.nearest(reference)
    shown_plan = part.plan("-", x + answer.combinations.visible(answer.proposal.x - x, part.lever))
    admitted, rows = part.plan("-", x), []
    for name, bone in segment_points(part.model).items():
        error, degrees = apart(answer.proposal.plan.motion(name), reference.motion(name), bone)
        visible_error, visible_degrees = apart(shown_plan.motion(name), admitted.motion(name), bone)
        rows.append(
            {
                "segment": name,
                "moved": float(np.linalg.norm(reference.motion(name).displacement(bone), axis=1).mean()),
                "error": error,
                "degrees": degrees,
                "told_error": visible_error,
                "told_degrees": visible_degrees,
            }
        )
    return rows


def apart(one: RigidMotion, other: RigidMotion, bone: np.ndarray) -> tuple[float, float]:
    """Mean distance (mm) of bone points (b, 3) under two motions, and the angle (degrees) between their rotations."""
    turn = RigidMotion(one.rotation @ other.rotation.T).degrees
    return float(np.linalg.norm(one.apply(bone) - other.apply(bone), axis=1).mean()), float(np.linalg.norm(turn))


def as_vector(motion: RigidMotion, middle: np.ndarray) -> np.ndarray:
    """QUANTITIES (6,) of a motion about the middle (3,) mm of its bone."""
    return np.concatenate([LPS * motion.displacement(middle[None])[0], motion.degrees])


def places_at(marks: Marks, motion: np.ndarray) -> Wish:
    """The marks wished to where a motion (l, 3) mm takes them."""
    return [
        PlaceWish(name, marks.chosen([name]), target, 1.0)
        for name, target in zip(marks.names, marks.rest + motion, strict=True)
    ]


def seen(model: PatientModel, marks: Marks, skin: SurfaceWish | np.ndarray) -> np.ndarray:
    """What a regression sees of a wished face, (3 (l + regions),) mm: where its landmarks and regions went.

    skin: displacement (s, 3) mm of the skin where it is known; of a surface the way to its closest point. Regions by
    the mean of their points.
    """
    near = closest_points(marks.rest, model.skin_points, model.skin_faces)
    if isinstance(skin, SurfaceWish):
        moved = closest_points(model.skin_points, skin.points, skin.faces).points - model.skin_points
    else:
        moved = skin
    corners = model.skin_faces[near.face]
    at_marks = np.einsum("lc,lcx->lx", near.weights, moved[corners])
    codes = regions(model)
    parts: Sequence[np.ndarray] = [moved[codes == number] for number in range(len(NAMES))]
    means = [part.mean(axis=0) if len(part) else np.zeros(3) for part in parts]
    return np.concatenate([at_marks.ravel(), *means])
