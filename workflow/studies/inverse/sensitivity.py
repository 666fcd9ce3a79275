"""Which move matters where: millimetres of every place of the face per millimetre and degree of every bone."""

import numpy as np
import pandas as pd

from pinnochio.columns import check
from pinnochio.geometry.rigid import RigidMotion
from pinnochio.mechanics.lift import motion_amplitudes
from pinnochio.model.patient import PatientModel
from pinnochio.model.regions import NAMES, regions
from pinnochio.plans.plan import Plan
from pinnochio.plans.sampling import JawAnatomy
from studies.inverse.elastic_face import ElasticFace
from studies.inverse.freedom import LPS, QUANTITIES
from studies.inverse.wish import Marks
from studies.inverse.wish_columns import SENSITIVITY


def sensitivity(face: ElasticFace, case: str, code: str) -> pd.DataFrame:
    """Rows of SENSITIVITY: each segment moved alone by one unit of each quantity, about its middle or its condyle."""
    model = face.model
    anatomy = JawAnatomy.from_points(model.bone_points, model.bone_segment, model.segments)
    places = Marks.of(model)
    codes = regions(model)
    rows = []
    for segment in model.segments:
        pivot = anatomy.hinge.get(segment, anatomy.centre[segment])
        # A ramus, or a mandible in its joints, can but turn.
        for number, quantity in list(enumerate(QUANTITIES))[3 if segment in anatomy.hinge else 0 :]:
            unit = np.zeros(6)
            unit[number] = 1
            plan = Plan(case, {segment: RigidMotion.from_degrees(unit[3:], LPS * unit[:3], pivot)})
            moved = face.elastic(motion_amplitudes(plan, model.segments, model.points.mean(axis=0)))
            for place, (mean, size) in mean_motions(model, places, codes, moved).items():
                row = {"case": case, "segment": segment, "quantity": quantity, "place": place}
                row |= dict(zip(QUANTITIES[:3], LPS * mean, strict=True))
                rows.append(row | {"moved": size, "code": code})
    return check(pd.DataFrame(rows), SENSITIVITY)


def mean_motions(
    model: PatientModel, places: Marks, codes: np.ndarray, field: np.ndarray
) -> dict[str, tuple[np.ndarray, float]]:
    """Mean motion (3,) mm LPS and mean distance, mm, of every landmark and every region under a field (n, 3) mm.

    codes (s,): region of every skin point.
    """
    motions = {}
    for name, motion in zip(places.names, places.moved(field) - places.rest, strict=True):
        motions[name] = motion, float(np.linalg.norm(motion))
    skin = model.moved_skin(field) - model.skin_points
    for number, name in enumerate(NAMES):
        region = skin[codes == number]
        if len(region):
            motions[f"region {name}"] = region.mean(axis=0), float(np.linalg.norm(region, axis=1).mean())
    return motions
