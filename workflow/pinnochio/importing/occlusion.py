"""A plan from two scans of the teeth in their final occlusion: where the second arch lies says where the mandible goes.

Each arch is registered on the teeth of its jaw before surgery, from any frame. The upper one brings the occlusion to
the patient's maxilla; there the lower one lies where the mandible shall be.
"""

import logging
import os
import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from scipy.spatial import cKDTree

from pinnochio.errors import refusal
from pinnochio.geometry.closed_surfaces import read_triangles, surfaces_in
from pinnochio.geometry.rigid import RigidMotion
from pinnochio.geometry.triangles import vertex_normals
from pinnochio.importing import segment_registration as bones
from pinnochio.importing.registration import coarse, spread
from pinnochio.importing.segmentation import Segmentation
from pinnochio.model.bones import above_teeth, of_segments
from pinnochio.model.surfaces import bone_surface
from pinnochio.plans.plan import Plan
from pinnochio.plans.roles import UNCUT, of_role
from pinnochio.plans.sampling import JawAnatomy, composed, ramus_following
from pinnochio.plans.transforms import read_transforms, transforms_in

LOG = logging.getLogger(__name__)
NAMES = {"upper": re.compile("upper|maxill"), "lower": re.compile("lower|mandib")}  # in the names of the files
BITE = 18.0  # mm from the other jaw: teeth, whichever way the head lies [I]
CROWN = 6.0  # mm from the other arch: crowns, and little gum [I]
WORST, LEAST, FEWEST = 0.6, 50.0, 50  # mm of median distance, % of the crowns on teeth, triangles [I]


def arches(folder: str | os.PathLike) -> dict[str, list[Path]]:
    """The surfaces of a folder that are called upper and lower, by these words."""
    return {
        jaw: [file for file in surfaces_in(folder) if word.search(file.stem.lower())] for jaw, word in NAMES.items()
    }


def read_occlusion(folder: str | os.PathLike, case: str, head: Segmentation, segments: Sequence[str]) -> Plan:
    """The plan of a folder with two arches in final occlusion in one frame and, where the maxilla moves too, its
    transform.

    head: the labels before surgery. Chin and rami of which there is no transform follow the mandible, the rami by
    turning about their condyles. InputError where a file is missing or fits no teeth, and for a maxilla in pieces.
    """
    refuse = refusal(case, folder)
    files = arches(folder)
    if sorted(map(len, files.values())) != [1, 1] or files["upper"] == files["lower"]:
        listed = ", ".join(file.name for file in surfaces_in(folder))
        refuse(f"it holds {listed}", "keep two scans, named upper and lower (upper.stl, lower.stl)")
    upper, lower = of_role(segments, "maxilla"), of_role(segments, "distal", UNCUT)
    if len(lower) != 1 or len(upper) > 1:
        refuse(f"{', '.join(upper + lower)} are no whole jaws", "give the motions of the pieces as transforms")
    moved = {}
    for file in transforms_in(folder):
        moved |= read_transforms(file, case)
    if lower[0] in moved:
        refuse(f"{lower[0]!r} has a transform beside the arches", "keep one of both")
    bone = bone_surface(head.labels, head.spacing, head.origin, tuple(segments), bones.EDGE)
    body = of_segments(bone.segment, segments, "distal", UNCUT)
    above = of_segments(bone.segment, segments, "maxilla") if upper else above_teeth(bone.points, bone.segment, body)
    jaws = [above, body]
    frames, start, scans = [], RigidMotion(), [read_triangles(files[jaw][0], refuse) for jaw in NAMES]
    for jaw, side, other, arch, against in zip(NAMES, jaws, jaws[::-1], scans, scans[::-1], strict=True):
        teeth = _beside(bone.points, bone.faces[side[bone.faces[:, 0]]], bone.points[other], BITE)
        crowns = _beside(*arch, against[0], CROWN)
        start = _registered(crowns, teeth, start, refusal(case, files[jaw][0]))
        frames.append(start)
    middle = bone.points[body].mean(axis=0)
    # The lower arch, off its teeth before surgery, goes where the upper one brings both.
    whole = composed(frames[0], frames[1].back, middle)
    if upper:
        whole = composed(moved.setdefault(upper[0], RigidMotion()), whole, middle)
    anatomy = JawAnatomy.from_points(bone.points, bone.segment, tuple(segments))
    follow = {name: ramus_following(anatomy, name, whole) for name in of_role(segments, "proximal")}
    follow |= {name: whole for name in (*of_role(segments, "chin"), *lower)}
    if derived := [name for name in follow if name not in (*moved, *lower)]:
        LOG.warning("case %r: %s: %s follow the mandible, without transforms", case, folder, ", ".join(derived))
    return Plan(case, follow | moved)


def _beside(points: np.ndarray, faces: np.ndarray, other: np.ndarray, reach: float) -> tuple[np.ndarray, np.ndarray]:
    """What of a surface lies within `reach` mm of other points (k, 3) mm."""
    near = np.isfinite(cKDTree(other).query(points, distance_upper_bound=reach)[0])
    used, corners = np.unique(faces[near[faces].all(axis=1)], return_inverse=True)
    return points[used], corners.reshape(-1, 3).astype(np.int32)


def _registered(crowns, teeth, start: RigidMotion, refuse) -> RigidMotion:
    """The motion that brings the crowns of an arch onto teeth, both points and faces; start: where to look first."""
    if min(len(crowns[1]), len(teeth[1])) < FEWEST:
        refuse("hardly any of it, or of its jaw, lies near the other one", "give both arches in occlusion, in mm")
    points, faces = start.apply(crowns[0]), crowns[1]
    normals = vertex_normals(points, faces)
    few, many = (spread(points, faces, count) for count in (bones.COARSE_SAMPLES, bones.SAMPLES))
    rotation, shift = coarse(points[few], normals[few], *teeth, -np.inf, teeth[0])
    scan = bones.VisibleBone(points[many], normals[many], np.arange(0, len(many), max(1, len(many) // bones.FEW)))
    target = bones.ScannedBone(teeth[0], vertex_normals(*teeth))
    motion = bones.fitted(scan, target, RigidMotion(rotation, shift))
    off = np.abs(target.pairs(motion.apply(scan.points), scan.normals @ motion.rotation.T, bones.CUT)[2])
    matched = 100 * float((off < bones.MATCHED).sum()) / len(many)
    median = float(np.median(off)) if len(off) else np.inf
    LOG.info("arch on its teeth: median %.2f mm, %.0f %% matched", median, matched)
    if not (median <= WORST and matched >= LEAST):
        refuse(
            f"registered on the teeth it leaves a median distance of {median:.2f} mm (limit {WORST:g} mm) and lies "
            f"within {bones.MATCHED:g} mm of them with {matched:.0f} % of the crowns (at least {LEAST:g} %)",
            "check that it is this jaw of this patient, in mm and not mirrored",
        )
    return RigidMotion(motion.rotation @ start.rotation, motion.apply(start.apply(np.zeros((1, 3))))[0])
