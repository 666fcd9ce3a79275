"""Makes the checked plan, in LPS mm, of what a user gives for an imported patient."""

import logging
from collections.abc import Mapping
from dataclasses import replace

from pinnochio.errors import refusal
from pinnochio.geometry.closed_surfaces import surfaces_in
from pinnochio.importing.segmentation import check_plan, check_travel, read_labels
from pinnochio.logs import collected
from pinnochio.model.surfaces import BoneSurface
from pinnochio.plans.areg import matrices, read_areg
from pinnochio.plans.plan import Plan
from pinnochio.plans.transforms import transforms_in
from pinnochio.volume_size import is_image


def import_plan(
    case: str,
    source: str,
    bone: str,
    plan: str,
    labels: str = "",
    label_values: Mapping[str, int | str] | str | None = None,
    limit: float = 0.45,
    share: float = 70.0,
    foreign: bool = False,
) -> None:
    """Read a plan file or a folder of transforms and write it; InputError where it does not fit the patient's bone.

    A source that is a segmentation, made after surgery and read as label_values say, is registered bone by bone on the
    patient's labels, as :mod:`register_segments` does: the plan is then the motion that was achieved. limit (mm), share
    (%): as there. A folder with both arches of teeth in final occlusion gives the mandible's motion
    (:mod:`pinnochio.importing.occlusion`). foreign: the plan may name another case.
    """
    with collected() as warnings:
        checked = _checked_plan(case, source, bone, labels, label_values, limit, share, foreign)
    replace(checked, warnings=tuple(warnings)).write(plan)


def _checked_plan(case, source, bone, labels, label_values, limit, share, foreign) -> Plan:
    """The plan, arguments as in :func:`import_plan`."""
    surface = BoneSurface.read(bone)
    if is_image(source):
        if any(file.suffix.lower() != ".txt" for file in transforms_in(source)):
            refusal(case, source)("it holds transforms beside label maps", "put each plan into a folder of its own")
        # These take a second, which other plans are spared.
        from pinnochio.importing.postop_bones import read_postop_bones
        from pinnochio.importing.segment_registration import check_fits, register_bones

        points, faces = read_postop_bones(source, case, surface.points, label_values)
        head = read_labels(labels)
        cranium, fits = register_bones(head, surface.segments, Plan(case, {}), points, faces, case=case, file=source)
        for fit in (cranium, *fits):
            logging.info("%s: median %.3f mm, %.0f %% matched", fit.segment, fit.median, fit.matched)
        check_fits((cranium, *fits), limit=limit, share=share, case=case, file=source)
        checked = Plan(case, {fit.segment: fit.motion for fit in fits})
    elif matrices(source):
        checked = read_areg(source, case, surface.segments)
    elif surfaces_in(source) and _holds_arches(source):
        from pinnochio.importing.occlusion import read_occlusion

        checked = read_occlusion(source, case, read_labels(labels), surface.segments)
    else:
        checked = Plan.read(source, case, foreign)
    check_plan(checked, surface.segments, source)
    check_travel(plan=checked, bone=surface, segments=surface.segments, path=source)
    return checked


def _holds_arches(folder: str) -> bool:
    """Whether surfaces of a plan's folder are arches: bones may lie beside transforms, which are then the plan."""
    from pinnochio.importing.occlusion import arches

    return all(arches(folder).values()) or not transforms_in(folder)
