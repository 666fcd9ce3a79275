"""Whether a displacement field is one that tissue could have: volume, equilibrium, boundary."""

import numpy as np
from scipy.spatial import cKDTree

from pinnochio.geometry.closest_points import closest_points
from pinnochio.mechanics.boundary.conditions import boundary_conditions
from pinnochio.mechanics.boundary.sliding import SlidingSurfaces
from pinnochio.mechanics.elements.assembly import diagonal_blocks
from pinnochio.mechanics.elements.tetrahedra import Elements, cell_volumes, jacobians
from pinnochio.mechanics.settings import FemSettings
from pinnochio.model.labels import TISSUES, segment_name
from pinnochio.model.patient import CUT_PLANE, FREE, MOVING, SLIDING, PatientModel
from pinnochio.plans.plan import Plan

# Change of a sliding node's distance to its bone, mm, from which it has left the bone. The surface that nodes slide on
# is smooth, so that it changes by 0.9 at most in moves of 5 mm [X].
OFF_BONE = 3.0
EDGE = 20.0  # mm from where the scan ends within which what lies beyond it matters [I]


def volume_metrics(points, cells, tissue, displacement) -> dict[str, float]:
    """min J, its 1st percentile, the count of inverted elements, and the change of volume of each tissue in %."""
    ratio, rest = jacobians(points, cells, displacement), cell_volumes(points, cells)
    metrics = {
        "min_jacobian": float(ratio.min()),
        "p1_jacobian": float(np.percentile(ratio, 1)),
        "inverted": int((ratio <= 0).sum()),
    }
    for name, code in TISSUES.items():
        part = tissue == code
        change = 100 * (np.average(ratio[part], weights=rest[part]) - 1) if part.any() else np.nan
        metrics[f"volume_change_{name}"] = float(change)
    return metrics


def equilibrium_of(
    patient: PatientModel, displacement, fem: FemSettings, forces=None, elements: Elements | None = None
) -> dict[str, float | str]:
    """:func:`equilibrium_metrics` of a patient's field (n, 3) mm, with the material and elements of the settings.

    forces (n, 3) mN: the load that the field declares, which inner forces balance; its size beside the force of all
    other nodes is load_rel. elements: those of the patient, where they are made already.
    """
    elements = elements or rest_elements(patient, fem)
    force, stiffness = elements.evaluate(displacement)[1], diagonal_blocks(elements, displacement)
    load = np.zeros_like(force) if forces is None else np.asarray(forces, float)
    metrics = equilibrium_metrics(force - load, stiffness, patient.node_type)
    free = patient.node_type == FREE
    reaction = np.linalg.norm((force - load)[~free])
    metrics["load_rel"] = float(np.linalg.norm(load[free]) / reaction if load.any() else 0.0)
    return metrics | {"eqres_element": fem.volumetric}


def rest_elements(patient: PatientModel, fem: FemSettings) -> Elements:
    """The patient's elements, of the material and kind of the settings."""
    return Elements.build(patient.points, patient.cells, fem.material(patient.tissue), fem.volumetric)


def equilibrium_metrics(force, stiffness, node_type) -> dict[str, float]:
    """EqRes in four forms over V_free, the nodes without any boundary condition (node_type FREE).

    eqres_paper: mean |f|^2, mN2; eqres_rms: its root, mN; eqres_rel: |f_free| / |f of all other nodes|, the
    headline, 0 where no force acts at all; eqres_disp: mean |K_ii^-1 f_i|, mm, the way that a node still wants to go.
    A sliding node counts among the others with its whole force: its tangential part, zero at equilibrium, is
    neither free force nor reaction alone. Values of different elements are not comparable.
    force (n, 3) mN: the internal force; stiffness (n, 3, 3) mN/mm: the diagonal blocks of the tangent.
    """
    free = np.asarray(node_type) == FREE
    inside, total, reaction = force[free], np.linalg.norm(force[free]), np.linalg.norm(force[~free])
    # Rounding: the force that moving one node by 1e-9 mm makes is no force.
    total, reaction = (0.0 if size < 1e-9 * np.abs(stiffness).max() else size for size in (total, reaction))
    square = np.mean((inside**2).sum(axis=1)) if len(inside) else 0.0
    wanted = np.linalg.norm((np.linalg.pinv(stiffness[free]) @ inside[..., None])[..., 0], axis=1)
    return {
        "eqres_paper": float(square),
        "eqres_rms": float(np.sqrt(square)),
        "eqres_rel": float(total / reaction if reaction > 0 else np.inf if total > 0 else 0.0),
        "eqres_disp": float(wanted.mean()) if len(wanted) else 0.0,
    }


def boundary_metrics(patient: PatientModel, plan: Plan, displacement) -> dict[str, float]:
    """Mean error in mm of the moving nodes against the rigid plan, of the sliding nodes against the moved bone.

    A sliding node should keep its signed distance to the bone that faces it, by the very surface that the solver
    slides it on (`boundary.sliding.SlidingSurfaces`); the error is the change of that distance, gap
    and penetration alike. NaN where the patient has no such node.
    """
    cue, _ = patient.reference_cue(plan)
    moving = patient.node_type == MOVING
    slides = SlidingSurfaces(patient.points, boundary_conditions(patient, plan, "mucosa").sliding)
    slid = slides.at(1.0).violation(displacement)
    return {
        "moving_error": float(np.linalg.norm(displacement - cue, axis=1)[moving].mean()) if moving.any() else np.nan,
        "sliding_error": float(np.abs(slid).mean()) if len(slid) else np.nan,
    }


def off_bone(patient: PatientModel, plan: Plan, displacement) -> np.ndarray:
    """Change (s,) in mm of the distance of each sliding node to the triangles of its bone, gap and depth alike.

    The surface that the solver slides nodes on goes on beyond the rim of the bone: a node there keeps its distance to
    that surface, and hangs in the air.
    """
    changes = [np.zeros(0)]
    for index in np.unique(patient.node_segment[patient.node_type == SLIDING]):
        nodes = np.flatnonzero((patient.node_type == SLIDING) & (patient.node_segment == index))
        faces = patient.bone_faces[(patient.bone_segment == index)[patient.bone_faces].all(axis=1)]
        if not len(faces):
            continue
        rest = patient.points[nodes]
        there = plan.motion(segment_name(index, patient.segments)).inverse(rest + displacement[nodes])
        before, after = (closest_points(places, patient.bone_points, faces).distance for places in (rest, there))
        changes.append(np.abs(after - before))
    return np.concatenate(changes)


def beside_edge(patient: PatientModel, moved) -> dict[str, float]:
    """edge_percent: share of the judged face's points within EDGE of where the scan ends; edge_moved_mm: the
    largest of their ways, of those (k,) mm of all judged points."""
    face, cut = patient.judged_points, patient.points[patient.node_beyond == CUT_PLANE]
    near = cKDTree(cut).query(patient.skin_points[face])[0] <= EDGE
    return {"edge_percent": 100 * near.mean(), "edge_moved_mm": float(moved[near].max(initial=0.0))}
