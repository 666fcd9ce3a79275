"""Pictures of a patient: before, outcome, predictions and their errors, rendered without a screen."""

import os
from collections.abc import Mapping

import numpy as np
import pyvista as pv
from scipy import sparse

from pinnochio.files import replacing
from pinnochio.geometry.mesh_topology import edge_graph
from pinnochio.mechanics.elements.tetrahedra import jacobians
from pinnochio.mechanics.held_lips import CLOSING, shown_skin
from pinnochio.methods.names import written
from pinnochio.model.patient import FIXED, MOVING, SLIDING, PatientModel
from pinnochio.plans.plan import Plan

SKIN, BONE, UNKNOWN = "#e8beac", "#efe9d9", "#cccccc"
COLUMNS = 6  # methods side by side
SEGMENTS = ("#d95f02", "#7570b3", "#1b9e77", "#66a61e", "#e7298a")
NODE_TYPES = {FIXED: "#444444", MOVING: "#d95f02", SLIDING: "#1f78b4"}
# Directions of view in LPS: the face looks to -y, the patient's left is +x.
FRONT, OBLIQUE, SIDE = (0, -1, 0.05), (0.75, -1, 0.15), (1, -0.05, 0.05)
BEHIND = (0.15, 1, 0.1)
REST = Plan("rest", {})
# Of the colours of values, beside a panel.
BAR = {"title": "mm", "vertical": True, "color": "black", "label_font_size": 16, "title_font_size": 16, "n_labels": 4}
BAR |= {"fmt": "%.1f", "position_x": 0.04, "position_y": 0.1, "height": 0.7, "width": 0.08}
FARTHEST = 4.0  # mm, where the scale of signed distances ends
ROUNDS, LEVELLED = 15, 0.25  # of averaging over neighbours; mm by which it shifts a point at most [I]


def skin_of(patient: PatientModel, displacement: np.ndarray) -> pv.PolyData:
    """The outer skin moved by a displacement (n, 3) mm, lips that cross in contact, with smooth normals."""
    return surface_of(shown_skin(patient, displacement), patient.skin_faces)


def held_skin(patient: PatientModel, displacement: np.ndarray) -> pv.PolyData:
    """The same with lips held, and without the dents of the mesh's edges in it: its motion averaged over neighbours, no
    point shifted by more than LEVELLED."""
    moved = shown_skin(patient, displacement, CLOSING)
    edges = np.vstack([patient.skin_faces[:, [0, 1]], patient.skin_faces[:, [1, 2]], patient.skin_faces[:, [2, 0]]])
    near = edge_graph(patient.skin_points, edges).astype(bool).astype(float)
    near = near.maximum(near.T) + sparse.eye_array(len(moved))
    shift = moved - patient.skin_points
    for _ in range(ROUNDS):
        shift = near @ shift / near.sum(axis=1)[:, None]
    shift += patient.skin_points - moved
    size = np.linalg.norm(shift, axis=1, keepdims=True)
    return surface_of(moved + shift * np.minimum(1, LEVELLED / np.maximum(size, 1e-9)), patient.skin_faces)


def surface_of(points: np.ndarray, faces: np.ndarray) -> pv.PolyData:
    """A surface of points (p, 3) mm and faces (f, 3), with smooth normals."""
    mesh = pv.PolyData.from_regular_faces(points, faces)
    return mesh.compute_normals(auto_orient_normals=False, split_vertices=False)


def field_picture(patient: PatientModel, plan: Plan, displacement: np.ndarray, path: str | os.PathLike) -> None:
    """Two rows of one solved plan: skin before and after, displacement in mm; bone, interfaces, skin over bone."""
    plotter = pv.Plotter(off_screen=True, shape=(2, 3), window_size=(1500, 1100))
    before, after = skin_of(patient, 0 * displacement), skin_of(patient, displacement)
    magnitude = np.linalg.norm(after.points - before.points, axis=1)
    for column, (title, skin, shown) in enumerate((("before", before, REST), ("after", after, plan))):
        plotter.subplot(0, column)
        add_face(plotter, skin, patient, shown)
        finish(plotter, title, OBLIQUE)
    plotter.subplot(0, 2)
    add_values(plotter, after, magnitude, (0, float(magnitude.max()) or 1.0), "viridis", BAR)
    finish(plotter, "displacement", OBLIQUE)
    plotter.subplot(1, 0)
    add_bone(plotter, patient, plan)
    finish(plotter, "planned bone", OBLIQUE)
    plotter.subplot(1, 1)
    for kind, colour in NODE_TYPES.items():
        nodes = patient.node_type == kind
        if nodes.any():
            plotter.add_points(patient.points[nodes], color=colour, point_size=7, render_points_as_spheres=True)
    finish(plotter, "fixed grey, moving orange, sliding blue", OBLIQUE)
    plotter.subplot(1, 2)
    add_face(plotter, after, patient, plan)
    finish(plotter, "after, side", SIDE)
    save(plotter, path)


def case_picture(
    patient: PatientModel,
    plan: Plan,
    target: tuple[np.ndarray, np.ndarray],
    skins: Mapping[str, pv.PolyData],
    errors: Mapping[str, np.ndarray],
    path: str | os.PathLike,
) -> None:
    """First row: before, planned bone, scan of the outcome (points, faces); then each method's face and error under it.

    skins: predicted skin by method; errors: signed distance (s,) mm of each of its points to the target, NaN where it
    is not judged.
    """
    columns = min(max(4, len(skins)), COLUMNS)
    rows = 1 + 2 * -(-len(skins) // columns)
    size = 420 * columns, 415 * rows
    plotter = pv.Plotter(off_screen=True, shape=(rows, columns), window_size=size, border=False)
    plotter.subplot(0, 0)
    add_face(plotter, skin_of(patient, np.zeros_like(patient.points)), patient, REST)
    finish(plotter, "before", OBLIQUE)
    plotter.subplot(0, 1)
    add_bone(plotter, patient, plan)
    finish(plotter, "moved bone", OBLIQUE)
    plotter.subplot(0, 2)
    add_face(plotter, surface_of(*target), patient, plan)
    finish(plotter, "outcome (scan)", OBLIQUE)
    for number, (method, skin) in enumerate(skins.items()):
        row, column = divmod(number, columns)
        plotter.subplot(1 + 2 * row, column)
        add_face(plotter, skin, patient, plan)
        finish(plotter, written(method), OBLIQUE)
        plotter.subplot(2 + 2 * row, column)
        actor = add_values(plotter, skin, errors[method], (-FARTHEST, FARTHEST), "coolwarm")
        finish(plotter, "distance to outcome", FRONT)
    if skins:
        plotter.subplot(0, 3)
        add_scale(plotter, actor, "signed distance [mm]")
    save(plotter, path)


def volume_picture(patient: PatientModel, displacements: Mapping[str, np.ndarray], path: str | os.PathLike) -> None:
    """The tissue from behind, moved by each method's displacement (n, 3) mm and coloured by det F of its elements."""
    columns = min(1 + len(displacements), COLUMNS)
    rows = -(-(1 + len(displacements)) // columns)
    plotter = pv.Plotter(off_screen=True, shape=(rows, columns), window_size=(420 * columns, 415 * rows), border=False)
    for number, (method, displacement) in enumerate(displacements.items()):
        plotter.subplot(*divmod(number, columns))
        grid = pv.UnstructuredGrid({pv.CellType.TETRA: patient.cells}, patient.points + displacement)
        grid.cell_data["ratio"] = ratio = jacobians(patient.points, patient.cells, displacement)
        outside = grid.extract_surface(algorithm="dataset_surface")
        actor = add_values(plotter, outside, outside.cell_data["ratio"], (0.5, 1.5), "PuOr")
        finish(plotter, f"{written(method)}: min det F {ratio.min():.2f}", BEHIND)
    plotter.subplot(rows - 1, columns - 1)
    add_scale(plotter, actor, "det F")
    save(plotter, path)


def add_face(plotter: "pv.Plotter", skin: pv.PolyData, patient: PatientModel, plan: Plan) -> None:
    """Skin, and behind it the bone after the plan: a mouth that is open shows teeth."""
    plotter.add_mesh(skin, color=SKIN, smooth_shading=True)
    moved = patient.bone_points + patient.bone_displacement(plan)
    plotter.add_mesh(pv.PolyData.from_regular_faces(moved, patient.bone_faces), color=BONE)


def add_bone(plotter: "pv.Plotter", patient: PatientModel, plan: Plan) -> None:
    """Bone after the plan, each segment in its colour."""
    moved = patient.bone_points + patient.bone_displacement(plan)
    owner = patient.bone_segment[patient.bone_faces[:, 0]]
    for index in range(-1, len(patient.segments)):
        faces = patient.bone_faces[owner == index]
        if len(faces):
            colour = BONE if index < 0 else SEGMENTS[index % len(SEGMENTS)]
            plotter.add_mesh(pv.PolyData.from_regular_faces(moved, faces), color=colour, smooth_shading=True)


def add_values(
    plotter: "pv.Plotter", surface: pv.PolyData, values: np.ndarray, limits, colours: str, bar: Mapping | None = None
) -> "pv.Actor":
    """Surface coloured by a value per point or face, grey where it is NaN; by default its bar is for another panel."""
    return plotter.add_mesh(
        surface,
        scalars=values,
        cmap=colours,
        clim=limits,
        nan_color=UNKNOWN,
        show_scalar_bar=bar is not None,
        scalar_bar_args=bar,
        ambient=0.2,
        copy_mesh=True,
    )


def add_scale(plotter: "pv.Plotter", actor: "pv.Actor", title: str) -> None:
    """The bar of an actor's colours in a panel of its own."""
    bar = {"vertical": True, "position_x": 0.3, "position_y": 0.1, "width": 0.16, "height": 0.8, "n_labels": 5}
    bar |= {"color": "black", "label_font_size": 18, "title_font_size": 18, "fmt": "%.1f"}
    plotter.add_scalar_bar(title=title, mapper=actor.mapper, **bar)
    plotter.set_background("white")


def finish(plotter: "pv.Plotter", title: str, direction) -> None:
    """Title and camera of the current panel."""
    plotter.set_background("white")
    plotter.add_text(title, position=(0.03, 0.94), viewport=True, font_size=9, color="black")
    plotter.view_vector(direction, viewup=(0, 0, 1))
    plotter.camera.parallel_projection = True
    plotter.camera.zoom(1.15)


def save(plotter: "pv.Plotter", path: str | os.PathLike) -> None:
    """Write the picture and close the plotter."""
    with replacing(path) as temporary:
        plotter.screenshot(temporary)
    plotter.close()
