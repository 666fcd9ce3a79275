"""Picture of a prediction and its interval: the face before and after, and how far off each place may be."""

import os

import numpy as np
import pyvista as pv

from pinnochio.figures.patient import FRONT, OBLIQUE, SKIN, UNKNOWN, finish, save, skin_of
from pinnochio.methods.names import in_sentence
from pinnochio.model.patient import PatientModel
from pinnochio.statistics.intervals import Calibration, Interval


def interval_picture(
    patient: PatientModel, interval: Interval, calibration: Calibration, case: str, path: str | os.PathLike
) -> None:
    """Before and predicted, then the half-width from the front and obliquely, on one scale for all patients."""
    plotter = pv.Plotter(off_screen=True, shape=(2, 2), window_size=(1300, 1250), border=False)
    after = skin_of(patient, interval.displacement)
    faces = {
        f"{case}: before": skin_of(patient, 0 * interval.displacement),
        f"predicted by {in_sentence(calibration.method)}": after,
    }
    for column, (title, skin) in enumerate(faces.items()):
        plotter.subplot(0, column)
        plotter.add_mesh(skin, color=SKIN)
        finish(plotter, title, OBLIQUE)
    bar = {"title": "mm", "vertical": True, "color": "black", "label_font_size": 18, "title_font_size": 18}
    bar |= {"position_x": 0.06, "position_y": 0.15, "height": 0.6, "width": 0.07}
    for column, direction in enumerate((FRONT, OBLIQUE)):
        plotter.subplot(1, column)
        plotter.add_mesh(
            after,
            scalars=interval.half_width,
            cmap="viridis",
            clim=(0, scale(calibration)),
            nan_color=UNKNOWN,
            show_scalar_bar=column == 1,
            scalar_bar_args=bar,
            copy_mesh=True,
        )
        finish(plotter, f"half-width at {100 * calibration.level:g} %", direction)
        plotter.camera.zoom(0.9)
    save(plotter, path)


def scale(calibration: Calibration) -> float:
    """Upper end of the colours, mm: one and a half times the largest calibrated half-width, rounded up to 0.5."""
    largest = max(value for value in calibration.half_width.values() if value is not None)
    return float(np.ceil(3 * largest)) / 2
