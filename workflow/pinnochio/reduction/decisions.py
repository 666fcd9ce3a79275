"""What of a patient's model a plan requires, each decision with its reason."""

import json
import os
from collections.abc import Mapping
from dataclasses import asdict, dataclass

import numpy as np

from pinnochio.errors import InputError
from pinnochio.files import replacing
from pinnochio.importing.segmentation import Segmentation
from pinnochio.mechanics.elements import mean_edge
from pinnochio.mechanics.settings import FemSettings
from pinnochio.meshing.fields import is_tissue
from pinnochio.meshing.interfaces import opposing_pairs
from pinnochio.model.labels import MUSCLE, segment_name
from pinnochio.model.patient import SLIDING, PatientModel
from pinnochio.model.surfaces import BoneSurface
from pinnochio.plans.plan import Plan
from pinnochio.reduction.amplitude import Amplitude, amplitude
from pinnochio.reduction.settings import SceneSettings

# A region that keeps more than SMALL of the tissue may leave out as much as keeps that, up to MOST times the amplitude:
# what moves far keeps much of the head above the amplitude, at a small error [X: docs/scene.md].
SMALL, MOST = 0.425, 3.0
WORTH = 0.9  # of the tissue: a region that keeps more is not worth the cut [I]
# Mean change of the face per mm of the largest motion, where muscle and superficial tissue are taken for one, over the
# logarithm of the ratio of their moduli [X: docs/scene.md].
LAYER_COST = 0.03
GRADED_COST, GRADED_SAVES = "0.08 to 0.24", "23 to 40 %"  # on the face, mm; of the nodes [X]
LAYER_LIMIT = 0.005  # mm; one layer saves no node, so it may cost next to nothing


@dataclass(frozen=True)
class Decision:
    """Whether a reduction is made (or which segments are followed), who says so (auto | hand), and why."""

    value: bool | tuple[str, ...]
    by: str
    reason: str


def decide(
    patient: PatientModel,
    head: Segmentation,
    plan: Plan,
    settings: SceneSettings,
    fem: FemSettings,
    sliding_band: float,
    release: float,
) -> tuple[dict[str, Decision], Amplitude, float]:
    """Decisions by name (`settings.REDUCTIONS` and "segments"), the amplitude, and the one (mm) that bounds the region.

    Of `patient` the bone, the places of the sliding nodes and the mean edge are read. sliding_band, release in mm: as
    for the interfaces.
    """
    bone = BoneSurface(patient.bone_points, patient.bone_normals, patient.bone_faces, patient.bone_segment)
    length = np.linalg.norm(patient.bone_displacement(plan), axis=1)
    motion = {
        name: float(length[patient.bone_segment == index].max(initial=0)) for index, name in enumerate(patient.segments)
    }
    listed = ", ".join(f"{name} {value:.2f}" for name, value in motion.items())
    if settings.segments == "auto":
        moving = tuple(name for name, value in motion.items() if value >= settings.still)
        segments = Decision(
            moving, "auto", f"these move by {settings.still} mm or more; largest motion in mm: {listed}"
        )
    else:
        moving = tuple(settings.segments)
        if unknown := [name for name in moving if name not in motion]:
            raise InputError(plan.case, "scene.segments", f"there is no {unknown[0]!r}", f"name some of {list(motion)}")
        segments = Decision(moving, "hand", f"set by hand; largest motion in mm: {listed}")
    pairs = opposing_pairs(bone, head.labels, head.spacing, head.origin, patient.segments, sliding_band)
    # Nodes of an element that reaches into the band slide with it; an edge from bone to bone is released whole.
    edge = mean_edge(patient.points, patient.cells)
    field = amplitude(
        head.labels,
        head.spacing,
        head.origin,
        patient.segments,
        plan,
        moving,
        pairs,
        band_mm=sliding_band + edge / 2,
        release_mm=release + edge,
    )

    tissue = is_tissue(head.labels)
    value = field.voxels()[tissue]
    limit, enough = settings.amplitude, float(np.quantile(value, 1 - SMALL))
    if limit < enough <= MOST * limit:
        limit = enough
    share = float((value > limit).mean())
    keep = f"{share:.0%} of the tissue can move by more than {limit:.3f} mm (at least {settings.amplitude} mm)"
    sliding = [tuple(segment_name(i, patient.segments) for i in pair) for pair in pairs]
    touched = [pair for pair in sliding if set(pair) & set(moving)]
    slides = patient.points[patient.node_type == SLIDING]
    slip = float(field.at(slides, head.spacing, head.origin).max(initial=0))
    largest = max((motion[name] for name in moving), default=0.0)
    ratio = abs(float(np.log(fem.youngs_modulus["muscle"] / fem.youngs_modulus["superficial"])))
    cost = LAYER_COST * ratio * largest if (head.labels == MUSCLE).any() else 0.0
    named = {
        "region": (0 < share < WORTH, f"{keep}; worth a cut below {WORTH:.0%}, if anything moves"),
        "bonded": (
            not touched and slip <= settings.amplitude,
            f"pairs that slide past each other: {_pairs(sliding)}; of these with a moving segment: {_pairs(touched)}; "
            f"tissue that slides can move by {slip:.3f} mm: bonded up to {settings.amplitude} mm without such a pair",
        ),
        "single_layer": (
            cost <= LAYER_LIMIT,
            f"one layer changes the face by about {cost:.3f} mm ({LAYER_COST} mm per mm of motion, here {largest:.2f}, "
            f"and unit of the log ratio of moduli, here {ratio:.2f}) and saves no node: made up to {LAYER_LIMIT} mm",
        ),
        "graded": (
            False,
            f"saves {GRADED_SAVES} of the nodes, but another lattice changes the face by {GRADED_COST} mm in the mean",
        ),
        "elastic": (
            largest <= settings.elastic_motion,
            f"largest motion {largest:.2f} mm; linear up to {settings.elastic_motion} mm",
        ),
    }
    decisions = {}
    for name, (wanted, reason) in named.items():
        asked = getattr(settings, name)
        made, by = (wanted, "auto") if asked == "auto" else (asked, "hand")
        decisions[name] = Decision(bool(made), by, reason)
    return {"segments": segments, **decisions}, field, limit


def write_decisions(case: str, plans: Mapping[str, Mapping[str, Decision]], path: str | os.PathLike) -> None:
    """Write the decisions for plans, by the plans' names, as JSON."""
    content = {plan: {name: asdict(made) for name, made in decisions.items()} for plan, decisions in plans.items()}
    with replacing(path) as temporary:
        temporary.write_text(json.dumps({"case": case, "plans": content}, indent=1) + "\n", encoding="utf-8")


def _pairs(pairs) -> str:
    return ", ".join(" and ".join(pair) for pair in pairs) or "none"
