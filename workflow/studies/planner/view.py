"""The picture of the planner: one or two faces from one camera, with bones, maps, profile, and the pivot's axes."""

from collections.abc import Sequence

import numpy as np
import pyvista as pv
from vtkmodules.vtkRenderingCore import vtkRenderer, vtkRenderWindow

from pinnochio.figures.patient import BONE, OBLIQUE, SEGMENTS, SKIN
from pinnochio.figures.profile import MidlineProfile
from pinnochio.geometry.triangles import vertex_normals
from pinnochio.model.patient import PatientModel
from pinnochio.statistics.intervals import Calibration
from studies.planner.forecast import Forecast
from studies.planner.session import SIDES

VIEWS = {"front": (0, -1, 0.05), "oblique": OBLIQUE, "left": (1, 0, 0.05), "right": (-1, 0, 0.05)}
BACKGROUND = "#eef1f4"
COLOURS = "viridis"
AXES = {"left": "#c62828", "back": "#2e7d32", "up": "#1565c0"}  # of x, y and z
ARROW = 45.0  # mm; from a pivot inside the bone it reaches beyond the face
THROUGH = 0.35  # opacity of skin through which bones are seen
NARROW = 1.4  # how much smaller heads are in half a window
FAR = 1000.0  # mm from the camera to the head


MAPS = ("none", "displacement", "interval")
MOST_MOVED = 10.0  # mm: upper end of the colours of the displacement
GHOST, SCAN = "#90a4ae", "#00897b"
PROFILE = {"before": "#546e7a", "after": "#c62828"}
WITHIN = 0.3  # mm by which the ghost lies within the skin before
AHEAD = 4.0  # mm in front of the face: the midline


class FaceView:
    """A window with a renderer for each side.

    limit: upper end of the colours of the half-width, mm; scan: points (k, 3) mm and faces of the post-operative skin.
    """

    def __init__(self, patient: PatientModel, limit: float, middle: float, scan: tuple | None = None):
        self.plotter = pv.Plotter(off_screen=True, shape=(1, len(SIDES)), border=False, window_size=(1100, 800))
        self.plotter.render_window.SetMultiSamples(0)  # smoothed edges take four times as long without a GPU [X]
        self._patient, self._both = patient, False
        self._sides: dict[str, Side] = {}
        profile = MidlineProfile(patient.skin_points, patient.skin_faces, middle)
        for column, side in enumerate(SIDES):
            self.plotter.subplot(0, column)
            self._sides[side] = Side(self.plotter, patient, limit, scan)
        self.plotter.link_views()
        window = self.plotter.render_window
        self._marks = {
            name: SideMarks(window, side.renderer.camera, profile, patient.skin_points, middle)
            for name, side in self._sides.items()
        }
        self.look("oblique")

    def show(self, side: str, forecast: Forecast, collisions: np.ndarray) -> None:
        """Show a forecast on one side, and the places (k, 3) mm where its bones collide."""
        self._sides[side].show(forecast)
        self._marks[side].show(forecast.skin, collisions)

    def mark(self, side: str, place: np.ndarray) -> None:
        """Put pivot and axes at a place (3,) mm of one side, and nowhere else."""
        for name, marks in self._marks.items():
            for actor in marks.pivot:
                actor.SetPosition(*place)
                actor.SetVisibility(name == side)

    def overlay(self, coloured: str, shown: Sequence[str]) -> None:
        """What the colours of the skin mean, one of MAPS, and what is seen beside it: bones, ghost (the skin before),
        profile, midline, scan."""
        for side, marks in zip(self._sides.values(), self._marks.values(), strict=True):
            side.colour(coloured)
            through = "bones" in shown
            side.skin.prop.opacity = THROUGH if through else 1.0
            side.skin.prop.culling = "back" if through else "none"  # the far side would only blur the bones
            side.paint_bones(through)
            for actors, name in ((side.ghost, "ghost"), (side.scan, "scan"),
                                 (marks.profile, "profile"), (marks.midline, "midline")):  # fmt: skip
                for actor in actors:
                    actor.SetVisibility(name in shown)

    def compare(self, both: bool, side: str) -> None:
        """Show both sides beside each other, or one alone."""
        for column, (name, drawn) in enumerate(self._sides.items()):
            viewport = (column / len(SIDES), 0, (column + 1) / len(SIDES), 1) if both else (0, 0, 1, 1)
            for renderer in (drawn.renderer, self._marks[name].renderer):
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
    """What is drawn of one plan: skin, bones, the skin before and the scan."""

    def __init__(self, plotter: pv.Plotter, patient: PatientModel, limit: float, scan: tuple | None):
        self._patient, self.renderer = patient, plotter.renderer
        self._limits = {"displacement": (0, MOST_MOVED), "interval": (0, limit)}
        plotter.set_background(BACKGROUND, all_renderers=False)
        self._mesh = pv.PolyData.from_regular_faces(patient.skin_points, patient.skin_faces)
        self._mesh.point_data.active_normals = vertex_normals(patient.skin_points, patient.skin_faces)
        for name in self._limits:
            self._mesh.point_data[name] = np.zeros(self._mesh.n_points)
        self.skin = plotter.add_mesh(
            self._mesh, color=SKIN, scalars="interval", cmap=COLOURS, clim=(0, limit), nan_color=SKIN,
            show_scalar_bar=False, ambient=0.3, diffuse=0.8, specular=0.1,
        )  # fmt: skip
        self._bones, self._bone_meshes = {}, {}
        for index in np.unique(patient.bone_segment):
            bone = patient.bone_segment == index
            faces = (np.cumsum(bone) - 1)[patient.bone_faces[bone[patient.bone_faces[:, 0]]]]
            self._bone_meshes[index] = pv.PolyData.from_regular_faces(patient.bone_points[bone], faces)
            self._bones[index] = plotter.add_mesh(self._bone_meshes[index])
        # Somewhat within, so that it shows only where the face has gone from.
        inside = patient.skin_points - WITHIN * vertex_normals(patient.skin_points, patient.skin_faces)
        before = pv.PolyData.from_regular_faces(inside, patient.skin_faces)
        self.ghost = [plotter.add_mesh(before, color=GHOST, opacity=0.35, culling="back")]
        self.scan = []
        if scan is not None:
            self.scan.append(plotter.add_mesh(pv.PolyData.from_regular_faces(*scan), color=SCAN, opacity=0.6))

    def colour(self, name: str) -> None:
        """Colour the skin by one of MAPS."""
        mapper = self.skin.mapper
        mapper.scalar_visibility = name in self._limits
        if name in self._limits:
            mapper.SetScalarModeToUsePointFieldData()
            mapper.SelectColorArray(name)
            mapper.scalar_range = self._limits[name]

    def paint_bones(self, apart: bool) -> None:
        """Each segment in its colour; else all as teeth, which a mouth that is open shows."""
        for index, bone in self._bones.items():
            bone.prop.color = bone_colour(index) if apart else BONE

    def show(self, forecast: Forecast) -> None:
        """Move skin and bones to where the forecast sees them."""
        self._mesh.points = forecast.skin
        self._mesh.point_data.active_normals = vertex_normals(forecast.skin, self._patient.skin_faces)
        self._mesh.point_data["interval"] = forecast.interval.half_width
        self._mesh.point_data["displacement"] = np.linalg.norm(forecast.skin - self._patient.skin_points, axis=1)
        moved = self._patient.bone_points + self._patient.bone_displacement(forecast.plan)
        for index, mesh in self._bone_meshes.items():
            mesh.points = moved[self._patient.bone_segment == index]


class SideMarks:
    """Pivot with axes, profile, midline and collisions in a layer of their own, which no skin hides, seen from the
    camera of a side."""

    def __init__(
        self, window: vtkRenderWindow, camera: pv.Camera, profile: MidlineProfile, skin: np.ndarray, middle: float
    ):
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
        self.pivot = [self._add(mesh, color=colour) for mesh, colour in parts]
        self._profile, self._after = profile, pv.PolyData(profile.of(skin), lines=profile.lines)
        before = pv.PolyData(profile.of(skin), lines=profile.lines)
        self.profile = [
            self._add(mesh, color=colour, line_width=3, lighting=False)
            for mesh, colour in zip((before, self._after), PROFILE.values(), strict=True)
        ]
        front = skin[:, 1].min() - AHEAD
        line = pv.Line((middle, front, skin[:, 2].min()), (middle, front, skin[:, 2].max()))
        self.midline = [self._add(line, color="#212121", line_width=2, lighting=False)]
        self._places = pv.PolyData(np.zeros((0, 3)))
        self._add(self._places, color="#d50000", point_size=6, render_points_as_spheres=True, lighting=False)

    def show(self, skin: np.ndarray, collisions: np.ndarray) -> None:
        """Draw the profile of a skin (s, 3) mm and the places (k, 3) mm of collisions."""
        self._after.points = self._profile.of(skin)
        self._places.copy_from(pv.PolyData(collisions) if len(collisions) else pv.PolyData())

    def _add(self, mesh: pv.DataSet, **look) -> pv.Actor:
        actor = pv.Actor(pv.DataSetMapper(mesh), pv.Property(**look))
        self.renderer.AddActor(actor)
        return actor


def bone_colour(index: int) -> str:
    """Colour of a segment, or of the cranium (-1)."""
    return BONE if index < 0 else SEGMENTS[index % len(SEGMENTS)]


def scale(calibration: Calibration) -> float:
    """Upper end of the colours, mm: one and a half times the largest calibrated half-width, rounded up to 0.5."""
    largest = max(value for value in calibration.half_width.values() if value is not None)
    return float(np.ceil(3 * largest)) / 2
