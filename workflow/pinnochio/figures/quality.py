"""Picture of a patient's model: soft tissue over the bones, the mesh cut open with its tissues and node types."""

import os

import numpy as np
import pyvista as pv

from pinnochio.figures.patient import BONE, FRONT, NODE_TYPES, SEGMENTS, SIDE, SKIN, add_bone, finish, save, skin_of
from pinnochio.model.labels import TISSUES, segment_name
from pinnochio.model.patient import FIXED, MOVING, SLIDING, PatientModel
from pinnochio.plans.plan import Plan
from pinnochio.plans.surgery import segment_in_words

COLOURS = {"superficial": "#f2c9a1", "muscle": "#b3423a"}
INWARD = (-1, -0.12, 0.05)  # view on the cut through the left half


def quality_picture(patient: PatientModel, case: str, path: str | os.PathLike) -> None:
    """Two views of the half-transparent skin over the bones; the left half of the mesh: tissues, node types."""
    plotter = pv.Plotter(off_screen=True, shape=(2, 2), window_size=(1300, 1300), border=False)
    skin = skin_of(patient, np.zeros_like(patient.points))
    present = [i for i in range(-1, len(patient.segments)) if (patient.bone_segment == i).any()]
    names = {segment_name(i, patient.segments): BONE if i < 0 else SEGMENTS[i % len(SEGMENTS)] for i in present}
    for column, (view, direction) in enumerate((("front", FRONT), ("left side", SIDE))):
        plotter.subplot(0, column)
        plotter.add_mesh(skin, color=SKIN, opacity=0.45)
        add_bone(plotter, patient, Plan(case, {}))
        _panel(plotter, f"{case}: bones under the skin, {view}", direction, names)

    mesh = pv.UnstructuredGrid({pv.CellType.TETRA: patient.cells}, patient.points)
    mesh.cell_data["tissue"] = patient.tissue
    middle = 0.5 * (patient.skin_points[:, 0].min() + patient.skin_points[:, 0].max())
    half = mesh.clip("-x", origin=(middle, 0, 0))
    plotter.subplot(1, 0)
    for name, code in TISSUES.items():
        part = half.extract_cells(half.cell_data["tissue"] == code)
        if part.n_cells:
            plotter.add_mesh(part, color=COLOURS[name], show_edges=True, edge_color="#7a6a5a", line_width=0.5)
    _panel(plotter, f"Left half of the mesh; muscle is {patient.muscle}", INWARD, COLOURS)
    plotter.subplot(1, 1)
    plotter.add_mesh(half, color="#dddddd", show_edges=True, edge_color="#aaaaaa", line_width=0.5)
    for code, colour in NODE_TYPES.items():
        nodes = (patient.node_type == code) & (patient.points[:, 0] > middle)
        if nodes.any():
            plotter.add_points(patient.points[nodes], color=colour, point_size=7, render_points_as_spheres=True)
    types = {"fixed": NODE_TYPES[FIXED], "moving": NODE_TYPES[MOVING], "sliding": NODE_TYPES[SLIDING]}
    _panel(plotter, "Left half of the mesh; types of its nodes", INWARD, types)
    save(plotter, path)


def _panel(plotter: "pv.Plotter", title: str, direction, colours: dict[str, str]) -> None:
    """Title, view and legend of the current panel, which stand clear of the picture."""
    finish(plotter, title, direction)
    plotter.camera.zoom(0.78)
    entries = [[segment_in_words(name), _readable(colour)] for name, colour in colours.items()]
    legend = plotter.add_legend(entries, face="rectangle", bcolor=None, size=(0.36, 0.036 * len(entries)))
    legend.SetPosition(0.63, 0.01)


def _readable(colour: str) -> tuple[float, ...]:
    """The colour, darkened where it would be too light on white."""
    rgb = np.array(pv.Color(colour).float_rgb)
    return tuple(rgb * min(1.0, 0.65 / rgb.mean()))
