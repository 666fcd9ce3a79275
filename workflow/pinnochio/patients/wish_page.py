"""One page to compare what each operation reaches of a wish, in one HTML file that needs nothing else."""

import base64
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import jinja2
import numpy as np
import pyvista as pv

from pinnochio.figures.patient import FRONT, SIDE, SKIN, UNKNOWN, add_bone, finish, skin_of
from pinnochio.files import replacing
from pinnochio.inverse.alternatives import Answer
from pinnochio.inverse.combinations import LARGEST, as_motions, differences, in_words
from pinnochio.inverse.freedom import operation_in_words
from pinnochio.inverse.proposal import InverseSettings
from pinnochio.inverse.wish import PlaceWish, SurfaceWish, Wish
from pinnochio.model.patient import PatientModel
from pinnochio.patients.certificate import RESEARCH, verdict
from pinnochio.patients.page import _png

SHOWN = 6  # combinations of motions that are named

TEMPLATE = """<!DOCTYPE html>
<html lang="en"><head><meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1"><title>{{ case }}: from the wish to a plan</title>
<style>
body { font: 16px/1.45 sans-serif; max-width: 1150px; margin: 1.5em auto; padding: 0 1em; color: #222 }
img { max-width: 100%; border: 1px solid #ddd } table { border-collapse: collapse; display: block; overflow-x: auto }
td, th { text-align: left; vertical-align: top; padding: .35em .5em; border-bottom: 1px solid #ddd }
td.n { text-align: right; white-space: nowrap } .no { font-weight: bold; color: #a40000 } .yes { color: #1a6b1a }
.box { border: 2px solid #b26a00; padding: .5em 1em; margin: 1em 0 }
</style></head><body>
<h1>{{ case }}: from the wished face to a plan</h1>
<p><b>{{ research }}</b> Faces are those of finite elements with sliding interfaces under each proposed plan. A wish
counts as met within {{ met }} mm, a measure within {{ met }} of its unit.</p>
{% for one, other, error in against -%}
<div class="box">{{ one }} and {{ other }} contradict each other: each can be met alone, together one of them is missed
by {{ "%.1f" | format(error) }} mm.</div>
{% endfor -%}
<h2>What each operation reaches</h2>
<table><tr><th>Operation</th><th>Moves</th><th>Wish missed by, mm</th><th>before surgery</th><th>All met</th>
<th>Largest motion, mm</th><th>At a bound</th><th>Not told apart</th><th>Solution</th></tr>
{% for row in rows -%}
<tr><td>{{ names[row.operation] }}</td><td>{{ moves[row.operation] }}</td>
<td class="n">{{ "%.2f" | format(row.misfit) }}</td><td class="n">{{ "%.2f" | format(row.wished) }}</td>
<td class="{{ 'yes' if row.reached else 'no' }}">{{ "yes" if row.reached else "no" }}</td>
<td class="n">{{ "%.1f" | format(row.motion_max) }}</td><td>{{ row.at_bounds or "–" }}</td>
<td class="n">{{ row.null_space }}</td><td>{{ grades[row.operation] }}</td></tr>
{% endfor -%}
</table>
<h2>Wish by wish</h2>
<p>By how much each is missed. Usually off: half-width of the interval within which a patient's own face should lie
about the predicted one, of a landmark, where finite elements are calibrated.</p>
<table><tr><th>Wish</th><th>before surgery</th><th>usually off</th>
{% for row in rows %}<th>{{ names[row.operation] }}</th>{% endfor %}</tr>
{% for name, unit, before, width, errors in wishes -%}
<tr><td>{{ name }}</td><td class="n">{{ "%.2f" | format(before) }} {{ unit }}</td>
<td class="n">{{ "± %.1f mm" | format(width) if width == width else "–" }}</td>
{% for error, met in errors %}<td class="n {{ 'yes' if met else 'no' }}">{{ "%.2f" | format(error) }}</td>{% endfor %}
</tr>
{% endfor -%}
</table>
{% for title, picture in pictures -%}
<h2>{{ title }}</h2><img alt="{{ title }}" src="data:image/png;base64,{{ picture }}">
{% endfor -%}
<p>From left to right: bones after the plan, the face from the front and from the side. {{ colours }}</p>
<h2>What the wish cannot tell apart</h2>
<p>These motions change the wished face by no more than {{ tolerance }} mm (root mean square), or by that at
{{ largest }} mm of bone, where they are cut off. Something else must decide about them: occlusion, airway, or the least
motion, as here.</p>
{% for name, lines in null_space.items() -%}
<h3>{{ name }}</h3>
{% if lines %}<ul>{% for line in lines %}<li>{{ line }}</li>{% endfor %}</ul>{% else %}<p>Nothing: the wish decides
about every motion within 1 mm of bone.</p>{% endif %}
{% endfor -%}
<h2>Files</h2>
<ul><li><code>plans/OPERATION.json</code>: the plan; copied to <code>plans/</code> of the patient's folder, the target
<code>predict</code> finds it, gives its interval and certificate, and the planner opens it</li>
<li><code>transforms/OPERATION/SEGMENT.tfm</code>: linear transforms for 3D Slicer</li>
<li><code>proposals.csv</code>, <code>reached.csv</code>, <code>motions.csv</code>, <code>combinations.csv</code>: the
numbers of this page</li></ul>
</body></html>
"""


@dataclass(frozen=True)
class WishTables:
    """What the tables say: rows of PROPOSALS, REACHED and COMBINATIONS, contradicting pairs, certificates, settings."""

    rows: Sequence[Mapping]
    reached: Sequence[Mapping]
    combinations: Sequence[Mapping]
    against: Sequence[tuple[str, str, float]]
    certificates: Mapping[str, Mapping | None]
    settings: InverseSettings


def write_wish_page(
    patient: PatientModel,
    case: str,
    wish: Wish,
    answers: Mapping[str, Answer],
    tables: WishTables,
    path: str | os.PathLike,
) -> None:
    """Write the page."""
    names = {name: operation_in_words(name) for name in answers}
    moves = {
        name: in_words(differences(answer.freedom, {}, answer.proposal.plan.motions))
        for name, answer in answers.items()
    }
    wishes = []
    for item in wish:
        reached = [row for row in tables.reached if row["wish"] == item.name]
        wishes.append(
            (
                item.name.replace("_", " "),
                item.unit,
                reached[0]["wished"],
                reached[0]["half_width"],
                [(r["error"], r["reached"]) for r in reached],
            )
        )
    grades = {
        name: "did not converge" if said is None else ", ".join((verdict(said).grade, *verdict(said).reasons))
        for name, said in tables.certificates.items()
    }
    null_space = {}
    for name, answer in answers.items():
        known = answer.combinations
        null_space[names[name]] = [
            f"± {min(bone, LARGEST):.1f} mm: "
            + in_words(as_motions(answer.freedom, answer.proposal.x, min(bone, LARGEST) * direction), 0.2)
            for direction, bone in zip(
                known.directions[known.hidden][:SHOWN], known.bone[known.hidden][:SHOWN], strict=True
            )
        ]
    surface = any(isinstance(item, SurfaceWish) for item in wish)
    page = jinja2.Environment(autoescape=True).from_string(TEMPLATE)
    text = page.render(
        case=case,
        research=RESEARCH,
        met=f"{tables.settings.met:g}",
        tolerance=f"{tables.settings.tolerance:g}",
        largest=f"{LARGEST:g}",
        against=tables.against,
        rows=tables.rows,
        names=names,
        moves=moves,
        wishes=wishes,
        grades=grades,
        null_space=null_space,
        pictures=[
            (f"{names[name]}: what is left of the wish", base64.b64encode(_picture(patient, wish, answer)).decode())
            for name, answer in answers.items()
        ],
        colours="Colours: signed distance of the face from the wished surface, red in front of it, blue behind."
        if surface
        else "Lines: from where a landmark comes to rest (blue) to where it is wished (red).",
    )
    with replacing(path) as temporary:
        temporary.write_text(text, encoding="utf-8")


def _picture(patient: PatientModel, wish: Wish, answer: Answer) -> bytes:
    """Bones, the face from the front and from the side, with the residual of the wish."""
    plotter = pv.Plotter(off_screen=True, shape=(1, 3), window_size=(1260, 430), border=False)
    proposal = answer.proposal
    skin = skin_of(patient, proposal.displacement)
    surface = next((item for item in wish if isinstance(item, SurfaceWish)), None)
    places = [item for item in wish if isinstance(item, PlaceWish)]
    plotter.subplot(0, 0)
    add_bone(plotter, patient, proposal.plan)
    finish(plotter, "bones", FRONT)
    bar = {"title": "mm", "vertical": True, "color": "black", "label_font_size": 16, "title_font_size": 16}
    bar |= {"n_labels": 5, "fmt": "%.1f", "position_x": 0.04, "position_y": 0.1, "height": 0.7, "width": 0.08}
    for column, (title, direction) in enumerate({"front": FRONT, "left side": SIDE}.items(), 1):
        plotter.subplot(0, column)
        if surface is None:
            plotter.add_mesh(skin, color=SKIN, opacity=0.6)
        else:
            off = surface.distances(proposal.displacement)
            far = max(float(np.nanpercentile(np.abs(off), 99)), 0.1)
            plotter.add_mesh(
                skin,
                scalars=off,
                cmap="coolwarm",
                clim=(-far, far),
                nan_color=UNKNOWN,
                show_scalar_bar=column == 1,
                scalar_bar_args=bar,
                copy_mesh=True,
            )
        for item in places:
            here = item.mark.moved(proposal.displacement)[0]
            plotter.add_mesh(pv.Line(here, item.target), color="#a40000", line_width=3)
            plotter.add_points(here[None], color="#1f3fbf", point_size=9, render_points_as_spheres=True)
            plotter.add_points(item.target[None], color="#a40000", point_size=9, render_points_as_spheres=True)
        finish(plotter, title, direction)
    return _png(plotter)
