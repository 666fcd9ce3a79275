"""Reduced models of a patient."""

from dataclasses import fields, replace

import numpy as np

from pinnochio.geometry.faces import pieces
from pinnochio.importing.segmentation import Segmentation
from pinnochio.mechanics.elements import mean_edge
from pinnochio.mechanics.sliding import boundary_conditions
from pinnochio.meshing.interfaces import label_interfaces
from pinnochio.meshing.lattice import tetrahedralize
from pinnochio.meshing.refinement import LONGEST_OVER_MEAN, refine
from pinnochio.model import patient as m
from pinnochio.model.labels import SUPERFICIAL
from pinnochio.model.surfaces import BoneSurface
from pinnochio.plans.plan import Plan
from pinnochio.reduction.amplitude import Amplitude
from pinnochio.reduction.decisions import Decision

PER_NODE = ("points", "node_type", "node_segment", "node_beyond", "node_normal", "interface_kind", "lip")
COARSE = 0.5  # nodes of the lattice that a graded mesh starts from, per node of the full one
FINE = 0.5  # mm of amplitude above which its elements are as small as those of the full one


def cropped(patient: m.PatientModel, wanted: np.ndarray) -> m.PatientModel:
    """The model without the cells (m,) bool that are not wanted; nodes on the cut are fixed, as on other cut planes.

    Pieces that are left without moving bone go too. All else is as it was, to the bit: the mesh of the full model is
    kept because another one moves the face by more than what is left out. The skin keeps all its points and triangles;
    where it hangs on what is left out it stays.
    """
    driven = np.isin(patient.node_type, (m.MOVING, m.SLIDING))
    driven[patient.cells[~wanted]] = False
    piece = pieces(patient.cells[wanted], len(driven))
    alive = np.isin(piece, piece[driven])
    wanted = wanted & alive[patient.cells[:, 0]]
    kept = np.zeros(len(driven), bool)
    kept[patient.cells[wanted]] = True
    cut = np.zeros(len(driven), bool)
    cut[patient.cells[~wanted]] = True
    number = np.where(kept, np.cumsum(kept) - 1, 0).astype(np.int32)
    node = {name: getattr(patient, name)[kept] for name in PER_NODE}
    for name, value in (("node_type", m.FIXED), ("node_segment", -1), ("node_beyond", m.CUT_PLANE)):
        node[name][cut[kept]] = value
    own = {item.name: getattr(patient, item.name) for item in fields(patient)}
    return m.PatientModel(
        **own
        | node
        | {
            "cells": number[patient.cells[wanted]],
            "tissue": patient.tissue[wanted],
            "skin_nodes": number[patient.skin_nodes],
            "skin_weights": patient.skin_weights * kept[patient.skin_nodes],
        }
    )


def in_region(patient: m.PatientModel, field: Amplitude, head: Segmentation, limit: float) -> np.ndarray:
    """Cells (m,) bool with a node or their middle where the amplitude is above `limit` mm."""
    inside = field.at(patient.points, head.spacing, head.origin) > limit
    middle = field.at(patient.points[patient.cells].mean(axis=1), head.spacing, head.origin) > limit
    return inside[patient.cells].any(axis=1) | middle


def bonded(patient: m.PatientModel) -> m.PatientModel:
    """The model with its sliding contact bonded to its bone, as in the arm "bonded"."""
    prescribed = np.zeros(len(patient.points), bool)
    prescribed[boundary_conditions(patient, Plan("-", {}), "bonded").prescribed_nodes] = True
    slides = patient.node_type == m.SLIDING
    kind = np.where(slides, np.where(prescribed, m.MOVING, m.FREE), patient.node_type).astype(np.int8)
    segment = np.where(slides & ~prescribed, -1, patient.node_segment).astype(np.int8)
    return replace(patient, node_type=kind, node_segment=segment)


def single_layer(patient: m.PatientModel) -> m.PatientModel:
    """The model with its muscle taken for superficial tissue."""
    kind = patient.interface_kind.copy()
    kind[kind == m.BONE_MUSCLE] = m.BONE_SUPERFICIAL
    kind[kind == m.MUSCLE_SUPERFICIAL] = m.NO_INTERFACE
    return replace(patient, tissue=np.full_like(patient.tissue, SUPERFICIAL), interface_kind=kind, muscle="single")


def graded(
    patient: m.PatientModel,
    head: Segmentation,
    skin: tuple[np.ndarray, np.ndarray],
    field: Amplitude,
    interfaces: dict[str, float],
) -> m.PatientModel:
    """A model of COARSE times the nodes, bisected to the patient's mean edge where the amplitude is above FINE.

    interfaces: thresholds in mm, as for `label_interfaces`.
    """
    longest = LONGEST_OVER_MEAN * mean_edge(patient.points, patient.cells)
    mesh = tetrahedralize(head.labels, head.spacing, head.origin, round(COARSE * len(patient.points)))
    mesh = refine(mesh, lambda points: np.where(field.at(points, head.spacing, head.origin) > FINE, longest, np.inf))
    bone = BoneSurface(patient.bone_points, patient.bone_normals, patient.bone_faces, patient.bone_segment)
    made = label_interfaces(
        mesh,
        head.labels,
        head.spacing,
        head.origin,
        patient.segments,
        bone,
        skin,
        **interfaces,
    )
    return replace(made, muscle=patient.muscle)


def reduced(
    patient: m.PatientModel,
    head: Segmentation,
    skin: tuple[np.ndarray, np.ndarray],
    decisions: dict[str, Decision],
    field: Amplitude,
    limit: float,
    interfaces: dict[str, float],
) -> m.PatientModel:
    """The model with the reductions that are decided for; `limit` in mm: tissue of less amplitude is left out."""
    if decisions["graded"].value:
        patient = graded(patient, head, skin, field, interfaces)
    if decisions["bonded"].value:
        patient = bonded(patient)
    if decisions["single_layer"].value:
        patient = single_layer(patient)
    if decisions["region"].value:
        patient = cropped(patient, in_region(patient, field, head, limit))
    return patient
