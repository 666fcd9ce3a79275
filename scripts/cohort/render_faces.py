"""Makes the contact sheet of the first virtual patients: face, skull and outcome of each."""

from collections.abc import Sequence

import pyvista as pv

from pinnochio.figures.patient import FRONT, OBLIQUE, REST, SIDE, SKIN, add_bone, finish, save, surface_of
from pinnochio.json_text import read_stored_json
from pinnochio.logs import attach_log
from pinnochio.model.patient import PatientModel
from pinnochio.model.truth import TrueMotion

BELOW = (0, -0.62, -0.78)
PANEL, ABREAST = (300, 330), 2  # pixels of a panel; patients side by side


def render_faces(
    cases: Sequence[str], models: Sequence[str], motions: Sequence[str], anatomies: Sequence[str], sheet: str
) -> None:
    """Draw all cases in one picture (PNG): the face from the front, the side and below, the skull, and the outcome from
    front and side."""
    views = [("", FRONT), ("side", SIDE), ("below", BELOW), ("skull", OBLIQUE), ("outcome", FRONT), ("outcome", SIDE)]
    shape = -(-len(cases) // ABREAST), ABREAST * len(views)
    size = shape[1] * PANEL[0], shape[0] * PANEL[1]
    plotter, cameras = pv.Plotter(off_screen=True, shape=shape, window_size=size, border=False), {}
    for place, (case, model, motion, anatomy) in enumerate(zip(cases, models, motions, anatomies, strict=True)):
        patient, about = PatientModel.read(model), read_stored_json(anatomy)
        skin = patient.skin_points + TrueMotion.read(motion, patient, case).skin
        for column, (words, direction) in enumerate(views):
            plotter.subplot(place // ABREAST, place % ABREAST * len(views) + column)
            if words == "skull":
                add_bone(plotter, patient, REST)
            else:
                points = skin if words == "outcome" else patient.skin_points
                plotter.add_mesh(surface_of(points, patient.skin_faces), color=SKIN, smooth_shading=True)
            finish(plotter, words or f"{case} {about['sex']} {about['deformity'].replace('_', ' ')}", direction)
            plotter.camera = cameras.setdefault((place, direction), plotter.camera)  # before and after alike
    save(plotter, sheet)


if __name__ == "__main__":
    attach_log(snakemake.log[0])
    render_faces(cases=snakemake.params.cases, **dict(snakemake.input.items()), sheet=snakemake.output.sheet)
