"""One page to look at a prediction: pictures, maps and the certificate, in one HTML file that needs nothing else."""

import base64
import os
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path

import jinja2
import numpy as np
import pyvista as pv

from pinnochio.figures.patient import FRONT, OBLIQUE, SIDE, SKIN, UNKNOWN, add_bone, finish, save, skin_of
from pinnochio.files import replacing
from pinnochio.methods.names import spoken
from pinnochio.model.bones import segment_points
from pinnochio.model.measures import MEASURES
from pinnochio.model.patient import PatientModel
from pinnochio.patients.certificate import in_words
from pinnochio.patients.exports import SPACE
from pinnochio.patients.face import MeasureRow, written
from pinnochio.plans.plan import Plan
from pinnochio.plans.surgery import in_words as motion_in_words
from pinnochio.plans.surgery import near_bone, segment_in_words

VIEWS = {"front": FRONT, "oblique": OBLIQUE, "left side": SIDE}

TEMPLATE = """<!DOCTYPE html>
<html lang="en"><head><meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1"><title>{{ c.case }}, {{ c.plan }}</title>
<style>
body { font: 16px/1.45 sans-serif; max-width: 1150px; margin: 1.5em auto; padding: 0 1em; color: #222 }
img { max-width: 100%; border: 1px solid #ddd } table { border-collapse: collapse; display: block; overflow-x: auto }
td, th { text-align: left; vertical-align: top; padding: .35em .5em; border-bottom: 1px solid #ddd }
li { overflow-wrap: anywhere }
td.n { text-align: right; white-space: nowrap } .no { font-weight: bold; color: #a40000 } .yes { color: #1a6b1a }
.box { border: 2px solid #a40000; padding: .5em 1em; margin: 1em 0 } .box.fine { border-color: #1a6b1a }
.box.care { border-color: #b26a00 }
details { margin: 1em 0 } summary { cursor: pointer; font-weight: bold }
</style></head><body>
<h1>{{ c.case }}: {{ c.plan }}</h1>
<p>Predicted by <b>{{ spoken(c.method) }}</b>
{%- if c.models %}, the mean of {{ c.models.folds }} models trained on {{ c.models.patients }} patients of the
{{ c.models.cohort }}{% endif %}
{%- if c.corrections %}; {{ c.corrections }} Newton correction{{ "s" if c.corrections > 1 }}{% endif %}.
{%- if c.expected %} Chosen from the measured trade-off: {{ spoken(c.expected.setting) }}. To expect, by
{{ c.expected.patients }} patients: {{ number(c.expected.seconds) }} s per plan (at most
{{ number(c.expected.seconds_max) }} s), {{ number(c.expected.cd) }} mm from the outcome
{%- if c.expected.cd_within is defined %} (nine in ten patients: ± {{ number(c.expected.cd_within) }} mm){% endif %}
{%- if c.expected.face_error is defined %}, {{ number(c.expected.face_error) }} mm from finite elements on a fine mesh
{%- endif %}.{% endif %}
<b>{{ c.research }}</b></p>
<div class="box {{ {'usable': 'fine', 'with care': 'care'}[c.verdict.grade] }}">
<b>{{ c.verdict.grade | capitalize }}.</b>
{% if c.verdict.reasons %}<ul>{% for reason in c.verdict.reasons %}<li>{{ reason }}</li>{% endfor %}</ul>
{% else %}{{ fine }}{% endif %}</div>
<h2>The plan</h2>
<table>{% for name, words in motions.items() %}<tr><td>{{ name }}</td><td>{{ words }}</td></tr>{% endfor %}</table>
{% for title, picture, words in pictures -%}
<h2>{{ title }}</h2><p>{{ words }}</p><img alt="{{ title }}" src="data:image/png;base64,{{ picture }}">
{% endfor -%}
{% if measures -%}
<h2>The face in numbers</h2>
<p>Before, after the plan and the change.{% if level %} ±: from the {{ level }} intervals of the places that a number is
read at, taken as independent; not calibrated by itself.{% endif %} A', B', Pog' and lips: + in front of their line.
Landmarks go with the skin. –: cannot be read on this face. The same numbers are in <code>measures.csv</code>.</p>
<table><tr><th>Measure</th><th>Before</th><th>After</th><th>Change</th>
{% if level %}<th>± {{ level }}</th>{% endif %}</tr>
{% for row in measures -%}
<tr><td>{{ row.title }}, {{ row.unit }}</td>{% for text in row.numbers %}<td class="n">{{ text }}</td>{% endfor %}</tr>
{% endfor -%}
</table>
<table><tr><th>Moves by, mm</th><th>Forward</th><th>Up</th><th>Left</th>
{% if level %}<th>± {{ level }}</th>{% endif %}</tr>
{% for title, texts in landmarks.items() -%}
<tr><td>{{ title }}</td>{% for text in texts %}<td class="n">{{ text }}</td>{% endfor %}</tr>
{% endfor -%}
</table>
{% endif -%}
<h2>Certificate</h2>
<table><tr><th></th><th>Value</th><th>What it means</th><th></th></tr>
{% for what, value, meaning, good, bad in rows -%}
<tr><td>{{ what }}</td><td>{{ value }}</td><td>{{ meaning }}</td>
<td class="{{ 'yes' if good else 'no' }}">{{ "" if good is none else "✓" if good else "✗" }}</td></tr>
{% endfor -%}
</table>
{% if c.in_distribution -%}
<details><summary>Every quantity that is compared with the training</summary>
<p>Excess: how far a value lies outside the range of the training patients, as a share of the range's width. The
ranges of movements begin at rest.</p>
{% for title in ("anatomy", "plan") -%}
<h3>{{ title }}: up to {{ "%.2f" | format(c.in_distribution[title].threshold) }} is usual</h3>
<table><tr><th>Quantity</th><th>This patient</th><th>Lowest</th><th>Highest</th><th>Excess</th></tr>
{% for name, q in c.in_distribution[title].quantities.items() -%}
<tr><td>{{ name }}</td>{% for key in ("value", "low", "high") %}<td class="n">{{ number(q[key]) }}</td>{% endfor %}
{% set far = q.excess is none or q.excess > c.in_distribution[title].threshold -%}
<td class="n {{ 'no' if far }}">{{ number(q.excess) }}</td></tr>
{% endfor -%}
</table>
{% endfor -%}
</details>
{%- endif %}
<h2>Files</h2>
<p>In the frame of the segmentation: LPS (x to the patient's left, y backwards, z up), millimetres. Each file says
so ({{ space }}), and 3D Slicer from 4.11 on shows it in place beside the scan; ParaView shows the numbers as they
stand.</p>
<ul>{% for name, words in files.items() %}<li><code>{{ name }}</code>: {{ words }}</li>{% endfor %}</ul>
<p>Archive of models: configuration {{ c.models.configuration if c.models else "none" }}, code
{{ c.models.code if c.models else "none" }}; predicted with code {{ c.code }}.</p>
</body></html>
"""
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
    path: str | os.PathLike,
) -> None:
    """Write the page of a field (n, 3) mm with half-widths (s,) mm of its skin, its certificate and its measures."""
    level = f"{100 * certificate['interval']['level']:g} %" if certificate["interval"] else ""
    before, after = skin_of(patient, np.zeros_like(displacement)), skin_of(patient, displacement)
    moved = np.linalg.norm(after.points - before.points, axis=1)
    pictures = [
        ("Before and after", _faces(before, after), "Above: before. Below: predicted."),
        ("Bones", _bones(patient, plan), "The bones after the plan, each segment in its colour."),
        ("Displacement", _map(after, moved), "How far each point of the skin moves."),
    ]
    if np.isfinite(half_width).any():
        words = f"Half-width of the {level} interval: {level} of a region's points should lie this near to the "
        words += "outcome. Grey: not judged."
        pictures.append((f"{level} interval", _map(after, half_width), words))
    measures, landmarks = in_numbers(rows, bool(level))
    fine = "No check failed: the elements are valid"
    fine += ", and patient and plan are like those of the training." if certificate["in_distribution"] else "."
    page = jinja2.Environment(autoescape=True).from_string(TEMPLATE)
    text = page.render(
        c=certificate,
        pictures=[(title, base64.b64encode(picture).decode(), words) for title, picture, words in pictures],
        rows=in_words(certificate),
        motions=motions_in_words(patient, plan),
        measures=measures,
        landmarks=landmarks,
        level=level,
        fine=fine,
        files=FILES,
        space=SPACE,
        spoken=spoken,
        number=lambda value: "–" if value is None else f"{value:.2f}",
    )
    with replacing(path) as temporary:
        temporary.write_text(text, encoding="utf-8")


def motions_in_words(patient: PatientModel, plan: Plan) -> dict[str, str]:
    """What a plan does with each segment, as surgeons say it: about its own pivot or, if that is far, its middle."""
    words = {}
    for name, bone in segment_points(patient).items():
        words[segment_in_words(name)] = motion_in_words(near_bone(plan.motion(name), bone.mean(axis=0)), name)
    return words


def in_numbers(rows: Sequence[MeasureRow], level: bool) -> tuple[list[dict], dict[str, list[str]]]:
    """Measures, and the ways of landmarks by title, as a page writes them; with half-widths if there is a level."""
    measures, landmarks = [], {}
    for row in rows:
        width = [written(row.half_width, 1)] if level else []
        if row.name in MEASURES:
            digits = 0 if row.unit == "degree" else 1
            texts = [written(row.before, digits), written(row.after, digits), written(row.change, 1, "+")]
            measures.append({"title": row.title, "unit": row.unit.replace("degree", "°"), "numbers": texts + width})
        else:
            landmarks.setdefault(row.title, []).append((written(row.change, 1, "+"), width))
    return measures, {title: [text for text, _ in ways] + ways[0][1] for title, ways in landmarks.items()}


def _faces(before: pv.PolyData, after: pv.PolyData) -> bytes:
    """Two rows: the skin before and after, from three sides."""
    plotter = _panels(2)
    for row, (title, skin) in enumerate({"before": before, "after": after}.items()):
        for column, (view, direction) in enumerate(VIEWS.items()):
            plotter.subplot(row, column)
            plotter.add_mesh(skin, color=SKIN)
            finish(plotter, f"{title}, {view}", direction)
    return _png(plotter)


def _bones(patient: PatientModel, plan: Plan) -> bytes:
    """The bones after the plan from three sides."""
    plotter = _panels(1)
    for column, (view, direction) in enumerate(VIEWS.items()):
        plotter.subplot(0, column)
        add_bone(plotter, patient, plan)
        finish(plotter, view, direction)
    return _png(plotter)


def _map(skin: pv.PolyData, values: np.ndarray) -> bytes:
    """The skin from three sides, coloured by a value (s,) mm per point, with one scale."""
    plotter = _panels(1)
    limits = 0, float(np.nanmax(values)) or 1.0
    bar = {"title": "mm", "vertical": True, "color": "black", "label_font_size": 16, "title_font_size": 16}
    bar |= {"n_labels": 4, "fmt": "%.1f", "position_x": 0.04, "position_y": 0.1, "height": 0.7, "width": 0.08}
    for column, (view, direction) in enumerate(VIEWS.items()):
        plotter.subplot(0, column)
        plotter.add_mesh(
            skin,
            scalars=values,
            cmap="viridis",
            clim=limits,
            nan_color=UNKNOWN,
            show_scalar_bar=not column,
            scalar_bar_args=bar,
            copy_mesh=True,
        )
        finish(plotter, view, direction)
        plotter.camera.zoom(0.9)
    return _png(plotter)


def _panels(rows: int) -> pv.Plotter:
    return pv.Plotter(off_screen=True, shape=(rows, len(VIEWS)), window_size=(1260, 430 * rows), border=False)


def _png(plotter: pv.Plotter) -> bytes:
    """The picture as a file would hold it."""
    with tempfile.TemporaryDirectory() as folder:
        save(plotter, Path(folder) / "picture.png")
        return (Path(folder) / "picture.png").read_bytes()
