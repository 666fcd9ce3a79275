"""Picture of an imported patient's bones: segments, landmarks, what decided about the cuts and what was repaired."""

import os
import textwrap
from collections.abc import Mapping

import numpy as np
import pyvista as pv

from pinnochio.figures.patient import BONE, FRONT, SEGMENTS, SIDE, SKIN, finish, save, surface_of
from pinnochio.importing.repair import KEPT
from pinnochio.model.labels import segment_name
from pinnochio.model.surfaces import BoneSurface

BELOW, OTHER_SIDE = (0.0, -0.45, -1.0), (-1, -0.05, 0.05)
CLOSING = "#e0801f"
ROWS, WIDTH = 14, 54  # lines of repairs that are listed; characters of a line


def segments_picture(
    bone: BoneSurface, skin: tuple[np.ndarray, np.ndarray], report: Mapping, path: str | os.PathLike
) -> None:
    """Bones from the front, both sides and below, with the skin about them; beside them what the report says."""
    present = [index for index in range(-1, len(bone.segments)) if (bone.segment == index).any()]
    colours = {index: BONE if index < 0 else SEGMENTS[index % len(SEGMENTS)] for index in present}
    plotter = pv.Plotter(off_screen=True, shape=(2, 3), window_size=(1800, 1200), border=False)
    views = (("front", FRONT), ("left side", SIDE), ("right side", OTHER_SIDE), ("below", BELOW))
    for number, (title, direction) in enumerate(views):
        plotter.subplot(*divmod(number if number < 2 else number + 1, 3))
        for index in present:
            part = bone.part(index)
            plotter.add_mesh(surface_of(part.points, part.faces), color=colours[index])
        if title != "below":
            plotter.add_mesh(surface_of(*skin), color=SKIN, opacity=0.15)
        for plane in (plane for planes in report.get("closed", {}).values() for plane in planes):
            drawn = {"center": plane["place"], "direction": plane["normal"], "i_size": plane["size"]}
            plotter.add_mesh(pv.Plane(**drawn, j_size=plane["size"]), color=CLOSING, opacity=0.25)
        # What lies on the other side is not seen.
        hidden = {"left side": ("RGo", "RCo"), "right side": ("LGo", "LCo")}.get(title, ())
        marks = {name: mark for name, mark in report.get("landmarks", {}).items() if name not in hidden}
        if marks:
            places = np.array([mark["place"] for mark in marks.values()])
            plotter.add_points(places, color="#1f3fbf", point_size=12, render_points_as_spheres=True)
            plotter.add_point_labels(
                places,
                list(marks),
                font_size=14,
                shape=None,
                text_color="#1f3fbf",
                always_visible=True,
                show_points=False,
            )
        finish(plotter, f"{report['case']}: {title}", direction)
    plotter.subplot(0, 2)
    entries = [[segment_name(index, bone.segments), colours[index]] for index in present]
    plotter.add_legend(entries, face="rectangle", bcolor="#888888", size=(0.4, 0.045 * len(entries)), loc="center left")
    plotter.subplot(1, 2)
    plotter.add_text("\n".join(_lines(report)), position="upper_left", font_size=11, color="black")
    save(plotter, path)


def _lines(report: Mapping) -> list[str]:
    """What the picture says in words."""
    lines = [f"frame, {name}: {text}" for name, text in report.get("frame", {}).items()]
    lines += [f"soft tissue: {report['soft_tissue']}"] if "soft_tissue" in report else []
    lines += [f"closed {name}: {len(planes)} planes (orange)" for name, planes in report.get("closed", {}).items()]
    lines += [f"cut {name}: {why}" for name, why in report.get("cuts", {}).items()]
    repairs = sorted((row for row in report["repairs"] if row["what"] != KEPT), key=lambda row: -row["voxels"])
    lines += ["", f"repairs: {sum(repair['voxels'] for repair in repairs)} voxels"]
    lines += [f"  {repair['structure']}: {repair['what']}, {repair['voxels']}" for repair in repairs[:ROWS]]
    return [piece for line in lines for piece in textwrap.wrap(line, WIDTH, subsequent_indent="   ") or [""]]
