"""One page to compare what each operation reaches of a wish, in one HTML file that needs nothing else."""

import os
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import pyvista as pv

from pinnochio.figures.patient import BAR, FRONT, SIDE, SKIN, add_bone, add_values, finish, skin_of
from pinnochio.geometry.rigid import RigidMotion
from pinnochio.model.patient import PatientModel
from pinnochio.patients.certificate import RESEARCH, verdict
from pinnochio.patients.prediction_page import panels, png
from pinnochio.plans.surgery import in_words, segment_in_words
from pinnochio.web_pages import write_page
from studies.inverse.alternatives import Answer
from studies.inverse.combinations import LARGEST
from studies.inverse.freedom import operation_in_words
from studies.inverse.proposal import InverseSettings
from studies.inverse.wish import PlaceWish, SurfaceWish, Wish

SHOWN = 6  # combinations of motions that are named

TEMPLATE = Path(__file__).with_name("wish_page.html")


def write_wish_page(
    patient: PatientModel,
    case: str,
    wish: Wish,
    answers: Mapping[str, Answer],
    rows: Sequence[Mapping],
    reached: Sequence[Mapping],
    against: Sequence[tuple[str, str, float]],
    certificates: Mapping[str, Mapping | None],
    settings: InverseSettings,
    path: str | os.PathLike,
) -> None:
    """Write the page. rows, reached: of PROPOSALS and REACHED; against: contradicting pairs; certificates: by
    operation."""
    names = {name: operation_in_words(name) for name in answers}
    moves = {name: _said(answer.proposal.plan.motions) for name, answer in answers.items()}
    wishes = []
    for item in wish:
        missed = [row for row in reached if row["wish"] == item.name]
        before = item.name.replace("_", " "), item.unit, missed[0]["wished"], missed[0]["half_width"]
        wishes.append((*before, [(row["error"], row["reached"]) for row in missed]))
    grades = {
        name: "did not converge" if said is None else ", ".join((verdict(said).grade, *verdict(said).reasons))
        for name, said in certificates.items()
    }
    null_space = {
        names[name]: [f"± {bone:.1f} mm: {_said(moves)}" for bone, hidden, moves in answer.moves() if hidden][:SHOWN]
        for name, answer in answers.items()
    }
    surface = any(isinstance(item, SurfaceWish) for item in wish)
    write_page(
        path,
        TEMPLATE,
        case=case,
        research=RESEARCH,
        met=f"{settings.met:g}",
        tolerance=f"{settings.tolerance:g}",
        largest=f"{LARGEST:g}",
        against=against,
        rows=rows,
        names=names,
        moves=moves,
        wishes=wishes,
        grades=grades,
        null_space=null_space,
        pictures=[
            (f"{names[name]}: what is left of the wish", _picture(patient, wish, answer))
            for name, answer in answers.items()
        ],
        colours="Colours: signed distance of the face from the wished surface, red in front of it, blue behind."
        if surface
        else "Lines: from where a landmark comes to rest (blue) to where it is wished (red).",
    )


def _said(motions: Mapping[str, RigidMotion]) -> str:
    """Motions of segments in words."""
    return "; ".join(f"{segment_in_words(name)}: {in_words(motion, name)}" for name, motion in motions.items())


def _picture(patient: PatientModel, wish: Wish, answer: Answer) -> str:
    """Bones, the face from the front and from the side, with the residual of the wish."""
    plotter, proposal = panels(1), answer.proposal
    skin = skin_of(patient, proposal.displacement)
    surface = next((item for item in wish if isinstance(item, SurfaceWish)), None)
    places = [item for item in wish if isinstance(item, PlaceWish)]
    plotter.subplot(0, 0)
    add_bone(plotter, patient, proposal.plan)
    finish(plotter, "bones", FRONT)
    for column, (title, direction) in enumerate({"front": FRONT, "left side": SIDE}.items(), 1):
        plotter.subplot(0, column)
        if surface is None:
            plotter.add_mesh(skin, color=SKIN, opacity=0.6)
        else:
            off = surface.distances(proposal.displacement)
            far = max(float(np.nanpercentile(np.abs(off), 99)), 0.1)
            add_values(plotter, skin, off, (-far, far), "coolwarm", BAR if column == 1 else None)
        for item in places:
            here = item.mark.moved(proposal.displacement)[0]
            plotter.add_mesh(pv.Line(here, item.target), color="#a40000", line_width=3)
            plotter.add_points(here[None], color="#1f3fbf", point_size=9, render_points_as_spheres=True)
            plotter.add_points(item.target[None], color="#a40000", point_size=9, render_points_as_spheres=True)
        finish(plotter, title, direction)
    return png(plotter)
