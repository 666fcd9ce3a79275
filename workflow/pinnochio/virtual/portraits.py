"""Pictures of virtual heads from their labels: face, skull and outcome."""

import os
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pyvista as pv
from PIL import Image
from scipy import ndimage

from pinnochio.files import replacing
from pinnochio.geometry.interpolation import interpolate
from pinnochio.importing.segmentation import Segmentation
from pinnochio.model.labels import AIR, CRANIUM, segment_code

SKIN, BONE = "#eac3ab", "#efe9d9"
SEGMENTS = ("#e39b63", "#9a96c8", "#62b394", "#62b394", "#e58fbc")
SKIN_SMOOTHING, BONE_SMOOTHING = 0.65, 0.5  # mm, Gaussian over the labels
HALF_HEIGHT = 106.0  # mm of a panel
FRONT, SIDE, BELOW, OBLIQUE = (0, -1, 0.03), (1, -0.02, 0.03), (0, -0.62, -0.78), (0.6, -1, 0.1)  # LPS
SHEET_PANEL, SHEET_PATIENTS = (210, 236), 2  # pixels of a panel of the contact sheet; patients side by side


@dataclass(frozen=True)
class Sitter:
    """Whom to draw: caption, labels and the names of the segments in the order of their codes."""

    caption: str
    head: Segmentation
    segments: tuple[str, ...]


def surface(inside: np.ndarray, head: Segmentation, smoothing: float, pass_band: float, mode: str) -> pv.PolyData:
    """Smooth surface of a voxel set; mode "edge" leaves it open where the volume cuts it, "constant" closes it."""
    padded = np.pad(inside, 4, mode=mode).astype(np.float32)
    padded = ndimage.gaussian_filter(padded, smoothing / head.spacing)
    image = pv.ImageData(dimensions=padded.shape, spacing=head.spacing, origin=head.origin - 4 * head.spacing)
    image["share"] = padded.ravel(order="F")
    mesh = image.contour([0.5], scalars="share").smooth_taubin(n_iter=60, pass_band=pass_band)
    low, high = head.origin, head.origin + head.spacing * (np.array(head.labels.shape) - 1)
    if mode == "edge":
        inside_box = mesh.clip_box(np.stack([low, high], 1).ravel(), invert=False)
        mesh = inside_box.extract_surface(algorithm="dataset_surface")
    return mesh.compute_normals(split_vertices=False, auto_orient_normals=False)


def add_bones(plotter: pv.Plotter, sitter: Sitter) -> None:
    """Draw the bones, each in its colour."""
    for index in range(-1, len(sitter.segments)):
        inside = sitter.head.labels == (CRANIUM if index < 0 else segment_code(index))
        if inside.any():
            bone = surface(inside, sitter.head, BONE_SMOOTHING, 0.08, "constant")
            colour = BONE if index < 0 else SEGMENTS[index % len(SEGMENTS)]
            plotter.add_mesh(bone, color=colour, smooth_shading=True, ambient=0.1)


def look(plotter: pv.Plotter, head: Segmentation, direction) -> None:
    """Point the camera at the middle of the face, from a direction (3,) in LPS."""
    plotter.set_background("white")
    middle = np.array([0, -50.0, head.origin[2] + head.spacing[2] * head.labels.shape[2] / 2 - 5])
    plotter.camera_position = [middle + 500 * np.array(direction), middle, (0, 0, 1)]
    plotter.camera.parallel_projection = True
    plotter.camera.parallel_scale = HALF_HEIGHT


def contact_sheet(
    sitters: Sequence[Sitter], fields: Sequence[tuple[np.ndarray, np.ndarray, np.ndarray]], path: str | os.PathLike
) -> None:
    """Of each patient the face from the front, the side and below, the skull, and the outcome from front and side.

    fields: points (n, 3) mm, cells (m, 4) and displacement (n, 3) mm of each outcome.
    """
    strips = [_strip(sitter, field) for sitter, field in zip(sitters, fields, strict=True)]
    strips += [np.full_like(strips[0], 255)] * (-len(strips) % SHEET_PATIENTS)
    rows = [np.hstack(strips[i : i + SHEET_PATIENTS]) for i in range(0, len(strips), SHEET_PATIENTS)]
    with replacing(path) as temporary:
        Image.fromarray(np.vstack(rows)).save(temporary, format="PNG")


def _strip(sitter: Sitter, field) -> np.ndarray:
    """Panels of one patient side by side, (height, width, 3) uint8."""
    skin = surface(sitter.head.labels != AIR, sitter.head, SKIN_SMOOTHING, 0.035, "edge")
    moved = skin.copy()
    moved.points = skin.points + interpolate(skin.points, *field)
    moved = moved.compute_normals(split_vertices=False, auto_orient_normals=False)
    views = [(skin, FRONT), (skin, SIDE), (skin, BELOW), (None, OBLIQUE), (moved, FRONT), (moved, SIDE)]
    panels = []
    for number, (mesh, direction) in enumerate(views):
        plotter = pv.Plotter(off_screen=True, window_size=SHEET_PANEL)
        plotter.enable_anti_aliasing("ssaa")
        if mesh is None:
            add_bones(plotter, sitter)
        else:
            plotter.add_mesh(mesh, color=SKIN, smooth_shading=True, ambient=0.15, specular=0.1)
        if number == 0:
            plotter.add_text(sitter.caption, position="lower_edge", font_size=7, color="black")
        if number == 4:
            plotter.add_text("outcome", position="lower_edge", font_size=7, color="black")
        look(plotter, sitter.head, direction)
        panels.append(plotter.screenshot(return_img=True))
        plotter.close()
    return np.hstack(panels)
