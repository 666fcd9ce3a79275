"""One page to look at a prediction: pictures, maps and the certificate, in one HTML file that needs nothing else."""

import base64
import io
import os
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path

import numpy as np
import pyvista as pv
from markupsafe import Markup

from pinnochio import web_pages
from pinnochio.figures.patient import BAR, FRONT, OBLIQUE, REST, SIDE, add_bone, add_face, add_values, finish, held_skin
from pinnochio.methods.names import spoken
from pinnochio.model.bones import segment_points
from pinnochio.model.patient import PatientModel
from pinnochio.patients.certificate import in_words
from pinnochio.patients.exports import SPACE
from pinnochio.patients.face_measures import MeasureRow, in_numbers
from pinnochio.plans.plan import Plan
from pinnochio.plans.surgery import in_words as motion_in_words
from pinnochio.plans.surgery import near_bone, segment_in_words
from pinnochio.statistics.intervals import Interval

VIEWS = {"front": FRONT, "oblique": OBLIQUE, "left side": SIDE}
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
    certificate: Mapping,
    pictures: Mapping[str, str],
    rows: Sequence[MeasureRow],
    tracing: str,
    path: str | os.PathLike,
) -> None:
    """Write the page of a prediction: its certificate, what :func:`draw_bones` and :func:`draw_faces` made, measures
    and cephalogram as SVG, empty where the face cannot be read."""
    level = f"{100 * certificate['interval']['level']:g} %" if certificate["interval"] else ""
    words = f"Half-width of the {level} interval: {level} of a region's points should lie this near to the outcome. "
    shown = {
        "faces": ("Before and after", "Above: before. Below: predicted, lips closed as before where muscle can."),
        "bones": ("Bones", "The bones after the plan, each segment in its colour."),
        "displacement": ("Displacement", "How far each point of the skin moves."),
        "interval": (f"{level} interval", words + "Grey: not judged."),
    }
    fine = "No check failed: the elements are valid"
    alike = certificate["in_distribution"] and certificate["in_distribution"]["within"]
    fine += ", and patient and plan are like those of the training." if alike else "."
    web_pages.write_page(
        path,
        TEMPLATE,
        c=certificate,
        pictures=[(title, pictures[name], words) for name, (title, words) in shown.items() if name in pictures],
        rows=in_words(certificate),
        motions=motions_in_words(patient, plan),
        **dict(zip(("measures", "landmarks", "bone"), in_numbers(rows), strict=True)),
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


def draw_bones(patient: PatientModel, plan: Plan) -> dict[str, str]:
    """A picture by its name, PNG in base 64: the bones after the plan from three sides."""
    return {"bones": _from_three_sides({"": lambda plotter, _: add_bone(plotter, patient, plan)})}


def draw_faces(patient: PatientModel, plan: Plan, result: Interval) -> dict[str, str]:
    """Such pictures of a result, with its interval where it has one."""
    before, after = (held_skin(patient, share * result.displacement) for share in (0, 1))
    rows = {
        "before, ": lambda plotter, _: add_face(plotter, before, patient, REST),
        "after, ": lambda plotter, _: add_face(plotter, after, patient, plan),
    }

    def coloured(values: np.ndarray) -> str:
        limits = 0, float(np.nanmax(values)) or 1.0
        show = partial(add_values, surface=after, values=values, limits=limits, colours="viridis")
        return _from_three_sides({"": lambda plotter, column: show(plotter, bar=None if column else BAR)}, zoom=0.9)

    moved = np.linalg.norm(after.points - before.points, axis=1)
    pictures = {"faces": _from_three_sides(rows), "displacement": coloured(moved)}
    return pictures | ({"interval": coloured(result.half_width)} if np.isfinite(result.half_width).any() else {})


def _from_three_sides(rows: Mapping[str, Callable], zoom: float = 1.0) -> str:
    """A row of panels for each title of what is shown there."""
    plotter = panels(len(rows))
    for row, (title, show) in enumerate(rows.items()):
        for column, (view, direction) in enumerate(VIEWS.items()):
            plotter.subplot(row, column)
            show(plotter, column)
            finish(plotter, title + view, direction)
            plotter.camera.zoom(zoom)
    return png(plotter)


def panels(rows: int) -> "pv.Plotter":
    return pv.Plotter(off_screen=True, shape=(rows, len(VIEWS)), window_size=(1260, 430 * rows), border=False)


def png(plotter: "pv.Plotter") -> str:
    """The picture as a page holds it: PNG in base 64."""
    picture = io.BytesIO()
    plotter.screenshot(picture)
    plotter.close()
    return base64.b64encode(picture.getvalue()).decode()
