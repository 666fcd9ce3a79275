"""Makes the motion that surgery gave each bone segment of the bones of a post-operative scan in any frame."""

import logging
from collections.abc import Mapping

from pinnochio.columns import write_rows
from pinnochio.importing.postop_bones import read_postop_bones
from pinnochio.importing.segment_registration import FITS, check_fits, register_bones
from pinnochio.importing.segmentation import read_labels
from pinnochio.model.surfaces import BoneSurface
from pinnochio.plans.plan import Plan


def register_segments(
    case: str,
    postop_bones: str,
    labels: str,
    bone: str,
    plan: str,
    limit: float,
    share: float,
    achieved: str,
    fits: str,
    label_values: Mapping | str | None = None,
) -> None:
    """Register the scanned bones on the cranium, then each segment on them, and write the motions as a plan.

    labels, bone: the patient before surgery; plan: the planned motions; limit (mm) is the median distance above which,
    share (%) the matched part of the surface below which a bone is refused (InputError). fits: one row per bone.
    """
    surface = BoneSurface.read(bone)
    points, faces = read_postop_bones(postop_bones, case, surface.points, label_values)
    head, planned = read_labels(labels), Plan.read(plan, case)
    cranium, registered = register_bones(head, surface.segments, planned, points, faces, case=case, file=postop_bones)
    rows = [{name: value for name, value in vars(fit).items() if name != "motion"} for fit in (cranium, *registered)]
    for row in rows:
        logging.info("%(segment)s: median %(median).3f mm, p90 %(p90).3f mm, %(matched).0f %% matched", row)
    check_fits((cranium, *registered), limit=limit, share=share, case=case, file=postop_bones)
    write_rows([{"case": case} | row for row in rows], fits, FITS)
    Plan(case, {fit.segment: fit.motion for fit in registered}).write(achieved)
