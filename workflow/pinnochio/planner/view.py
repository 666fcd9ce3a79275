"""The picture of the planner: one or two faces from one camera, bones, interval, and the pivot with its axes."""

import numpy as np
import pyvista as pv
from vtkmodules.vtkRenderingCore import vtkRenderer, vtkRenderWindow

from pinnochio.figures.patient import BONE, OBLIQUE, SEGMENTS, SKIN
from pinnochio.geometry.triangles import vertex_normals
from pinnochio.model.patient import PatientModel
from pinnochio.planner.forecast import Forecast
from pinnochio.planner.session import SIDES

VIEWS = {"front": (0, -1, 0.05), "oblique": OBLIQUE, "left": (1, 0, 0.05), "right": (-1, 0, 0.05)}
BACKGROUND = "#eef1f4"
COLOURS = "viridis"
AXES = {"left": "#c62828", "back": "#2e7d32", "up": "#1565c0"}  # of x, y and z
ARROW = 45.0  # mm; from a pivot inside the bone it reaches beyond the face
THROUGH = 0.35  # opacity of skin through which bones are seen
NARROW = 1.4  # how much smaller heads are in half a window
FAR = 1000.0  # mm from the camera to the head


class View:
    """A window with a renderer for each side; limit: upper end of the colours of the half-width, mm."""

    def __init__(self, patient: PatientModel, limit: float):
        self.plotter = pv.Plotter(off_screen=True, shape=(1, len(SIDES)), border=False, window_size=(1100, 800))
        self.plotter.render_window.SetMultiSamples(0)  # smoothed edges take four times as long without a GPU [X]
        self._patient, self._both = patient, False
        self._sides: dict[str, Side] = {}
        for column, side in enumerate(SIDES):
            self.plotter.subplot(0, column)
            self._sides[side] = Side(self.plotter, patient, limit)
        self.plotter.link_views()
        window = self.plotter.render_window
        self._marks = {name: Marks(window, side.renderer.camera) for name, side in self._sides.items()}
        self.look("oblique")

    def show(self, side: str, forecast: Forecast) -> None:
        """Show a forecast on one side."""
        self._sides[side].show(forecast)

    def mark(self, side: str, place: np.ndarray) -> None:
        """Put pivot and axes at a place (3,) mm of one side, and nowhere else."""
        for name, marks in self._marks.items():
            for actor in marks.actors:
                actor.SetPosition(*place)
                actor.SetVisibility(name == side)

    def overlay(self, interval: bool, bones: bool) -> None:
        """Whether the skin shows the half-width of the interval, and whether bones are seen through it."""
        for side in self._sides.values():
            side.skin.mapper.scalar_visibility = interval
            side.skin.prop.opacity = THROUGH if bones else 1.0
            side.skin.prop.culling = "back" if bones else "none"  # the far side would only blur the bones
            for actor in side.bones:
                actor.SetVisibility(bones)

    def compare(self, both: bool, side: str) -> None:
        """Show both sides beside each other, or one alone."""
        for column, (name, own) in enumerate(self._sides.items()):
            viewport = (column / len(SIDES), 0, (column + 1) / len(SIDES), 1) if both else (0, 0, 1, 1)
            for renderer in (own.renderer, self._marks[name].renderer):
                renderer.SetViewport(*viewport)
                renderer.SetDraw(both or name == side)
        if both != self._both:
            self.plotter.camera.parallel_scale *= NARROW if both else 1 / NARROW
            self._both = both

    def look(self, view: str) -> None:
        """Look at the whole head from one of VIEWS."""
        out = np.array(VIEWS[view]) / np.linalg.norm(VIEWS[view])
        across = np.cross([0, 0, 1], out) / np.linalg.norm(out[:2])
        axes = np.array([across, np.cross(out, across), out])
        seen = self._patient.skin_points @ axes.T
        low, high = seen.min(axis=0), seen.max(axis=0)
        middle = (low + high) / 2 @ axes
        self.plotter.camera_position = [middle + FAR * out, middle, (0, 0, 1)]
        self.plotter.camera.parallel_projection = True
        self.plotter.camera.parallel_scale = 0.55 * (high - low)[1] * (NARROW if self._both else 1)
        self.plotter.renderer.ResetCameraClippingRange()


class Side:
    """What is drawn of one plan: skin and bones."""

    def __init__(self, plotter: pv.Plotter, patient: PatientModel, limit: float):
        self._patient, self.renderer = patient, plotter.renderer
        plotter.set_background(BACKGROUND, all_renderers=False)
        self._mesh = pv.PolyData.from_regular_faces(patient.skin_points, patient.skin_faces)
        self._mesh.point_data.active_normals = vertex_normals(patient.skin_points, patient.skin_faces)
        self._mesh.point_data["half_width"] = np.zeros(self._mesh.n_points)
        self.skin = plotter.add_mesh(
            self._mesh, color=SKIN, scalars="half_width", cmap=COLOURS, clim=(0, limit), nan_color=SKIN,
            show_scalar_bar=False, ambient=0.3, diffuse=0.8, specular=0.1,
        )  # fmt: skip
        self.bones, self._bone_meshes = [], {}
        for index in np.unique(patient.bone_segment):
            own = patient.bone_segment == index
            faces = (np.cumsum(own) - 1)[patient.bone_faces[own[patient.bone_faces[:, 0]]]]
            self._bone_meshes[index] = pv.PolyData.from_regular_faces(patient.bone_points[own], faces)
            self.bones.append(plotter.add_mesh(self._bone_meshes[index], color=bone_colour(index)))

    def show(self, forecast: Forecast) -> None:
        """Move skin and bones to where the forecast sees them."""
        self._mesh.points = forecast.skin
        self._mesh.point_data.active_normals = vertex_normals(forecast.skin, self._patient.skin_faces)
        self._mesh.point_data["half_width"] = forecast.interval.half_width
        moved = self._patient.bone_points + self._patient.bone_displacement(forecast.plan)
        for index, mesh in self._bone_meshes.items():
            mesh.points = moved[self._patient.bone_segment == index]


class Marks:
    """Pivot and axes in a layer of their own, which no skin hides, seen from the camera of a side."""

    def __init__(self, window: vtkRenderWindow, camera: pv.Camera):
        self.renderer = vtkRenderer()
        self.renderer.SetLayer(window.GetNumberOfLayers())
        window.SetNumberOfLayers(window.GetNumberOfLayers() + 1)
        self.renderer.SetActiveCamera(camera)
        self.renderer.InteractiveOff()
        window.AddRenderer(self.renderer)
        parts = [(pv.Sphere(radius=2.5), "#212121")]
        for axis, colour in zip(np.eye(3), AXES.values(), strict=True):
            arrow = pv.Arrow(direction=axis, scale=ARROW, tip_length=0.18, tip_radius=0.045, shaft_radius=0.016)
            parts.append((arrow, colour))
        self.actors = [pv.Actor(pv.DataSetMapper(mesh), pv.Property(color=colour)) for mesh, colour in parts]
        for actor in self.actors:
            self.renderer.AddActor(actor)


def bone_colour(index: int) -> str:
    """Colour of a segment, or of the cranium (-1)."""
    return BONE if index < 0 else SEGMENTS[index % len(SEGMENTS)]
