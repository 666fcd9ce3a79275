"""One page to look at a prediction: pictures, maps and the certificate, in one HTML file that needs nothing else."""

import base64
import io
import os
from collections.abc import Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path

import numpy as np
import pyvista as pv
from markupsafe import Markup

from pinnochio import web_pages
from pinnochio.figures.patient import FRONT, OBLIQUE, REST, SIDE, add_bone, add_face, add_values, finish, skin_of
from pinnochio.methods.names import spoken
from pinnochio.model.bones import segment_points
from pinnochio.model.patient import PatientModel
from pinnochio.patients.certificate import in_words
from pinnochio.patients.exports import SPACE
from pinnochio.patients.face_measures import MeasureRow, in_numbers
from pinnochio.plans.plan import Plan
from pinnochio.plans.surgery import in_words as motion_in_words
from pinnochio.plans.surgery import near_bone, segment_in_words

VIEWS = {"front": FRONT, "oblique": OBLIQUE, "left side": SIDE}
BAR = {"title": "mm", "vertical": True, "color": "black", "label_font_size": 16, "title_font_size": 16, "n_labels": 4,
       "fmt": "%.1f", "position_x": 0.04, "position_y": 0.1, "height": 0.7, "width": 0.08}  # fmt: skip

TEMPLATE = Path(__file__).with_name("prediction_page.html")
FILES = {
    "deformed.vtu": "tetrahedra after the plan; displacement and type of nodes, tissue and volume ratio of elements",
    "skin.vtp": "predicted skin; displacement and half_width of the interval (NaN where there is none) of its points",
    "skin.ply, skin.stl": "predicted skin",
    "bones/*.stl": "each bone after the plan",
    "measures.csv": "the face in numbers",
    "certificate.json": "the numbers of the table above, and more",
}


def write_page(
    patient: PatientModel,
    plan: Plan,
    displacement: np.ndarray,
    half_width: np.ndarray,
    certificate: Mapping,
    rows: Sequence[MeasureRow],
    tracing: str,
    path: str | os.PathLike,
) -> None:
    """Write the page of a field (n, 3) mm with half-widths (s,) mm of its skin, its certificate, its
    measures and its cephalogram as SVG, empty where the face cannot be read."""
    level = f"{100 * certificate['interval']['level']:g} %" if certificate["interval"] else ""
    before, after = skin_of(patient, np.zeros_like(displacement)), skin_of(patient, displacement)
    moved = np.linalg.norm(after.points - before.points, axis=1)
    with ProcessPoolExecutor(2, get_context("fork")) as artists:
        draw = artists.submit
        pictures = [
            ("Before and after", draw(_faces, patient, plan, before, after), "Above: before. Below: predicted."),
            ("Bones", draw(_bones, patient, plan), "The bones after the plan, each segment in its colour."),
            ("Displacement", draw(_map, after, moved), "How far each point of the skin moves."),
        ]
        if np.isfinite(half_width).any():
            words = f"Half-width of the {level} interval: {level} of a region's points should lie this near to the "
            words += "outcome. Grey: not judged."
            pictures.append((f"{level} interval", draw(_map, after, half_width), words))
    measures, landmarks, bone = in_numbers(rows)
    fine = "No check failed: the elements are valid"
    alike = certificate["in_distribution"] and certificate["in_distribution"]["within"]
    fine += ", and patient and plan are like those of the training." if alike else "."
    web_pages.write_page(
        path,
        TEMPLATE,
        c=certificate,
        pictures=[(title, base64.b64encode(picture.result()).decode(), words) for title, picture, words in pictures],
        rows=in_words(certificate),
        motions=motions_in_words(patient, plan),
        measures=measures,
        landmarks=landmarks,
        bone=bone,
        tracing=Markup(tracing),
        level=level,
        fine=fine,
        files=FILES,
        space=SPACE,
        spoken=spoken,
        number=lambda value: "–" if value is None else f"{value:.2f}",
    )


def motions_in_words(patient: PatientModel, plan: Plan) -> dict[str, str]:
    """What a plan does with each segment, as surgeons say it: about its own pivot or, if that is far, its middle."""
    words = {}
    for name, bone in segment_points(patient).items():
        words[segment_in_words(name)] = motion_in_words(near_bone(plan.motion(name), bone.mean(axis=0)), name)
    return words


def _faces(patient: PatientModel, plan: Plan, before: pv.PolyData, after: pv.PolyData) -> bytes:
    """Two rows: the skin before and after, from three sides."""
    plotter = panels(2)
    for row, (title, skin, shown) in enumerate((("before", before, REST), ("after", after, plan))):
        for column, (view, direction) in enumerate(VIEWS.items()):
            plotter.subplot(row, column)
            add_face(plotter, skin, patient, shown)
            finish(plotter, f"{title}, {view}", direction)
    return png(plotter)


def _bones(patient: PatientModel, plan: Plan) -> bytes:
    """The bones after the plan from three sides."""
    plotter = panels(1)
    for column, (view, direction) in enumerate(VIEWS.items()):
        plotter.subplot(0, column)
        add_bone(plotter, patient, plan)
        finish(plotter, view, direction)
    return png(plotter)


def _map(skin: pv.PolyData, values: np.ndarray) -> bytes:
    """The skin from three sides, coloured by a value (s,) mm per point, with one scale."""
    plotter = panels(1)
    limits = 0, float(np.nanmax(values)) or 1.0
    for column, (view, direction) in enumerate(VIEWS.items()):
        plotter.subplot(0, column)
        add_values(plotter, skin, values, limits, "viridis", None if column else BAR)
        finish(plotter, view, direction)
        plotter.camera.zoom(0.9)
    return png(plotter)


def panels(rows: int) -> "pv.Plotter":
    return pv.Plotter(off_screen=True, shape=(rows, len(VIEWS)), window_size=(1260, 430 * rows), border=False)


def png(plotter: "pv.Plotter") -> bytes:
    """The picture as a file would hold it."""
    picture = io.BytesIO()
    plotter.screenshot(picture)
    plotter.close()
    return picture.getvalue()
