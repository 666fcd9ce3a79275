"""What the page of the planner looks like: bones on the left, the face in the middle, numbers on the right."""

import numpy as np
from matplotlib import colormaps
from matplotlib.colors import to_hex
from trame.ui.vuetify3 import VAppLayout
from trame.widgets import client, html
from trame.widgets import vtk as vtk_widgets
from trame.widgets import vuetify3 as v3

from pinnochio.patients.certificate import RESEARCH
from pinnochio.plans.surgery import AMOUNTS, segment_in_words
from studies.inverse.freedom import operation_in_words
from studies.planner.session import SIDES
from studies.planner.view import AXES, COLOURS, GHOST, MAPS, MOST_MOVED, PROFILE, SCAN, VIEWS, bone_colour, scale

NUMBER = (
    "width: 4rem; border: 1px solid #bbb; border-radius: 4px; padding: 0 .3rem; text-align: right; font-size: .8rem"
)
WISHED = NUMBER.replace("4rem", "3.2rem").replace(".8rem", ".72rem")
SWITCH = {"hide_details": True, "density": "compact", "color": "primary"}
FIELD = {"hide_details": True, "density": "compact", "variant": "outlined"}
CARE = "color: #b26a00"
SMALL = {"size": "small", "variant": "tonal"}
NARROW = 900  # pixels of a window; below it the picture stays on top and all else is scrolled past beneath it
STYLE = f"""
* {{ transition: none !important; animation: none !important }}
@media (max-width: {NARROW - 1}px) {{
  .v-application__wrap > .v-app-bar, .v-application__wrap > .v-navigation-drawer {{
    position: static !important; width: 100% !important; height: auto !important; flex: none; z-index: 1 !important
  }}
  .v-application__wrap > .v-app-bar {{ order: 1 }} .v-application__wrap > .v-navigation-drawer {{ order: 2 }}
  .v-application__wrap > .v-main {{
    --v-layout-left: 0 !important; --v-layout-right: 0 !important; --v-layout-top: 0 !important; flex: none;
    height: 56vh !important; position: sticky; top: 0; z-index: 2; background: white; border-bottom: 1px solid #bbb
  }}
  .v-app-bar > .v-toolbar__content {{ height: auto !important; flex-wrap: wrap; padding: .3rem }}
  .v-navigation-drawer:not(.v-navigation-drawer--active) {{ display: none }}
  .words {{ max-height: 5.2rem; overflow-y: auto }} .legend {{ min-height: 0 !important }}
}}
.numbers {{ border-collapse: collapse; width: 100% }}
.numbers td, .numbers th {{ padding: .08rem .3rem; text-align: right; white-space: nowrap; font-size: .74rem }}
.numbers td:first-child, .numbers th:first-child {{ text-align: left; white-space: normal }}
.numbers tr:nth-child(even) {{ background: #f5f5f5 }}
.v-slider.v-input--horizontal {{ margin-top: -8px; margin-bottom: -8px }}
.v-navigation-drawer .v-switch .v-label {{ font-size: .78rem }}
.v-navigation-drawer .v-switch .v-selection-control {{ min-height: 28px }}
.tracing {{ flex: 1; min-height: 0; background: white }}
.tracing > div {{ flex: 1; min-width: 0; padding: .5rem }}
.tracing svg {{ width: 100%; height: 100% }}
.far {{ {CARE}; font-weight: bold }}
"""
# Keys of the whole page; those of a field that is being typed in stay its own, but for undo and redo of numbers.
KEYS = """
document.addEventListener('keydown', (event) => {
  const field = document.activeElement, inside = (places) => field && field.closest(places);
  const click = (id) => {
    const button = document.getElementById(id);
    if (button) { event.preventDefault(); button.click(); }
  };
  const key = event.key.toLowerCase();
  if (event.ctrlKey || event.metaKey) {
    if (inside('#name')) return;
    if (key === 'z') click(event.shiftKey ? 'redo' : 'undo');
    else if (key === 'y') click('redo');
    return;
  }
  if (event.altKey || inside('#name, .v-select, input[type=number]')) return;
  const ids = { a: 'side_A', b: 'side_B', r: 'reset', f: 'look_front', o: 'look_oblique', p: 'look_left',
    t: 'tracing' };
  if (ids[key]) click(ids[key]);
  else if (/^[1-9]$/.test(key)) {
    const chips = document.querySelectorAll('[id^=segment_]');
    if (chips[key - 1]) chips[key - 1].click();
  }
});
"""
HELP = "Keys: 1-9 bone, arrows on a slider, Ctrl+Z / Ctrl+Y, R reset, A / B plan, F front, O oblique, P profile, "
HELP += "T tracing"


def build(page) -> vtk_widgets.VtkRemoteView:
    """Lay out the page; the picture of its view."""
    with VAppLayout(page.server) as layout:
        page.ui = layout
        client.Style(STYLE)
        client.Script(KEYS)
        _bar(page)
        with v3.VNavigationDrawer(permanent=True, width=296), html.Div(classes="pa-2"):
            _segment(page)
            v3.VDivider(classes="my-2")
            _files(page)
        with v3.VNavigationDrawer(v_model=("numbers",), location="right", width=400, permanent=True):
            _measures(page)
        with v3.VMain(classes="d-flex flex-column", style="height: 100vh"):
            _captions(page)
            remote = vtk_widgets.VtkRemoteView(
                page.view.plotter.render_window, interactive_ratio=1, interactive_quality=70,
                style="flex: 1; min-height: 0", v_show=("!traced",),
            )  # fmt: skip
            with html.Div(v_if=("traced",), classes="d-flex tracing", id="tracings"):
                for side in SIDES:
                    html.Div(v_if=(f"both || side == '{side}'",), v_html=(f"rows.{side}.tracing",))
            _legend(page)
    return remote


def _bar(page) -> None:
    """Plans, what is seen, and from where."""
    with v3.VAppBar(density="compact", flat=True, border=True):
        html.B(page.session.case, classes="ml-3 mr-2", style="white-space: nowrap")
        toggle = {"mandatory": True, "density": "compact", "divided": True, "color": "primary"}
        with v3.VBtnToggle(v_model=("side",), **toggle):
            for side in SIDES:
                v3.VBtn(f"Plan {side}", value=side, id=f"side_{side}", size="small")
        v3.VSwitch(v_model=("both",), label="both", id="both", classes="ml-3 flex-grow-0", **SWITCH)
        for name, icon, enabled in (("undo", "mdi-undo", "can_undo"), ("redo", "mdi-redo", "can_redo")):
            v3.VBtn(
                icon=icon, id=name, title=f"{name} (Ctrl+{'Z' if name == 'undo' else 'Y'})", size="small",
                disabled=(f"!{enabled}",), click=(page.do, f"['{name}']"),
            )  # fmt: skip
        v3.VBtn("reset", id="reset", title="move nothing (R)", variant="text", size="small",
                click=(page.do, "['reset']"))  # fmt: skip
        v3.VSpacer()
        v3.VSelect(
            v_model=("shown",), items=("seen", [{"title": words, "value": name} for name, words in
                                                page.seen.items()]),
            multiple=True, label="show", id="shown", style="max-width: 8.5rem", **FIELD,
        )  # fmt: skip
        v3.VBtn(
            "tracing", id="tracing", size="small", min_width=0, classes="px-2", click="traced = !traced",
            variant=("traced ? 'flat' : 'text'",), color="primary", title="lateral cephalogram (T)",
        )  # fmt: skip
        with v3.VBtnToggle(v_model=("map",), classes="ml-2", **toggle):
            for name in MAPS:
                v3.VBtn({"none": "no map"}.get(name, name), value=name, id=f"map_{name}", size="small")
        for view in VIEWS:
            v3.VBtn(
                {"left": "profile"}.get(view, view), id=f"look_{view}", size="small", variant="text",
                min_width=0, classes="px-2", click=(page.look, f"['{view}']"),
            )  # fmt: skip
        v3.VBtn("numbers", id="numbers", size="small", variant="text", click="numbers = !numbers")
        v3.VProgressLinear(id="busy", v_if=("busy",), model_value=100, absolute=True, location="bottom")


def _segment(page) -> None:
    """Which segment moves, how far, and about which point."""
    v3.VSelect(v_model=("preset",), items=("presets", page.session.presets), label="Start from", id="preset", **FIELD)
    with v3.VChipGroup(v_model=("segment",), mandatory=True, column=True):
        for index, name in enumerate(page.session.patient.segments):
            with v3.VChip(value=name, id=f"segment_{name}", filter=True, size="small"):
                html.Span("⬤", style=f"color: {bone_colour(index)}; margin-right: .4em")
                html.Span(segment_in_words(name))
    for name in AMOUNTS:
        with html.Div(classes="d-flex justify-space-between align-center"):
            html.Label(
                f"{{{{ labels.{name} }}}}", id=f"label_{name}", style="font-size: .74rem",
                classes=(f"{{far: far.includes('{name}')}}",),
            )  # fmt: skip
            html.Input(
                value=(f"(Math.round(10 * {name}) / 10 + 0).toFixed(1)",), id=f"number_{name}",  # + 0: no -0
                type="number", step=0.1, style=NUMBER,
                change=(page.enter, f"['{name}', $event.target.value]"),
            )  # fmt: skip
        v3.VSlider(
            v_model=(name,), min=("-reach",), max=("reach",), step=0.1, id=f"slider_{name}", hide_details=True,
            density="compact", color=(f"far.includes('{name}') ? 'warning' : 'primary'",), end=page.settle,
            aria_label=name,
        )  # fmt: skip
    with html.Div(classes="d-flex align-center mt-1", style="font-size: .78rem; gap: .3rem"):
        html.Span("turns about")
        for axis, name in enumerate("xyz"):
            html.Input(
                value=(f"pivot[{axis}]",), id=f"pivot_{name}", type="number", step=1, style=NUMBER,
                change=(page.enter_pivot, f"[{axis}, $event.target.value]"),
            )  # fmt: skip
    if page.session.jaws.rami or page.session.jaws.chin:
        v3.VSwitch(v_model=("carry",), label="mandible carries rami and chin", id="carry", **SWITCH)
    if page.session.jaws.upper and page.session.jaws.lower:
        v3.VSwitch(v_model=("locked",), label="keep the occlusion (jaws locked)", id="locked", **SWITCH)
        v3.VBtn(
            "Final occlusion", id="occlude", block=True, title=page.session.occlusion, classes="my-1", **SMALL,
            click=(page.do, "['occlude']"),
        )  # fmt: skip
    v3.VBtn("Leave this segment in place", id="stay", block=True, **SMALL, click=(page.do, "['stay']"))


def _files(page) -> None:
    """Opening, copying and saving plans."""
    v3.VSelect(v_model=("opened",), items=("plans",), label="Open a plan", id="open", **FIELD)
    v3.VBtn("Take over the other plan", id="copy", block=True, classes="my-2", **SMALL, click=(page.do, "['copy']"))
    with html.Div(classes="d-flex", style="gap: .4rem"):
        v3.VTextField(v_model=("name",), label="Save as", id="name", maxlength=64, **FIELD)
        v3.VBtn("Save", id="save", color="primary", disabled=("!name",), click=page.save)
    html.P(f"{HELP}. {RESEARCH}", classes="mt-2 text-caption")


def _measures(page) -> None:
    """Before, after, change and interval of the measures, of one plan or of both."""
    level = f"{100 * page.calibration.level:g} %"
    with html.Table(id="measures", classes="numbers"):
        with html.Tr():
            html.Th("")
            html.Th("before")
            for side in SIDES:
                html.Th(f"{side} after", v_if=(f"both || side == '{side}'",))
                html.Th("change", v_if=(f"both || side == '{side}'",))
                html.Th(f"± {level}", v_if=(f"!both && side == '{side}'",))
            html.Th("wish", v_if=("!both",))
        with html.Tr(v_for="row, place in rows[side].measures", key="row.name"):
            html.Td("{{ row.title }}")
            html.Td("{{ row.before }}")
            for side in SIDES:
                cell = f"(rows.{side}.measures[place] || {{}})"
                html.Td(f"{{{{ {cell}.after }}}}", v_if=(f"both || side == '{side}'",))
                html.Td(f"{{{{ {cell}.change }}}}", v_if=(f"both || side == '{side}'",))
                html.Td(f"{{{{ {cell}.half }}}}", v_if=(f"!both && side == '{side}'",))
            with html.Td(v_if=("!both",)):
                html.Input(
                    value=("wishes[row.name]",), type="number", step=0.5, style=WISHED, title="wished value",
                    id=("'wish_' + row.name",), change=(page.wish, "[row.name, $event.target.value]"),
                )  # fmt: skip
    with html.Div(classes="d-flex pa-2", style="gap: .4rem", v_if=("!both && operation",)):
        words = [{"title": operation_in_words(name), "value": name} for name in page.wishing.operations]
        v3.VSelect(
            v_model=("operation",), items=("operations", words), label="move", id="operation",
            style="min-width: 9rem", **FIELD,
        )  # fmt: skip
        v3.VBtn(
            "Fit the plan", id="fit", color="primary", click=page.fit, loading=("seeking",),
            disabled=("!Object.keys(wishes).length",), title="seeks the least motion that meets the wished values",
        )  # fmt: skip
    with html.Table(id="bone", classes="numbers mt-2"):
        with html.Tr():
            for title in ("{{ side }}: bone", "before", "after", "change"):
                html.Th(title)
        with html.Tr(v_for="row in rows[side].bone", key="row.name"):
            for name in ("title", "before", "after", "change"):
                html.Td(f"{{{{ row.{name} }}}}")
    with html.Table(id="landmarks", classes="numbers mt-2"):
        with html.Tr():
            for title in ("{{ side }}: moves by, mm", "forward", "up", "left", f"± {level}"):
                html.Th(title)
        with html.Tr(v_for="row in rows[side].landmarks", key="row.title"):
            for name in ("title", "forward", "up", "left", "half"):
                html.Td(f"{{{{ row.{name} }}}}")
    html.P(
        f"±: the {level} interval, calibrated on each measure by itself; of a landmark, that of the skin there. "
        "E-line, N' vertical: + in front. –: cannot be read on this face.",
        classes="text-caption pa-2",
    )


def _captions(page) -> None:
    """What was done or refused, and what is shown of each plan, in words above its picture."""
    v3.VAlert(
        "{{ said }}", v_if=("said",), id="said", type=("failed ? 'error' : 'success'",), density="compact",
        style="flex: none; overflow-wrap: anywhere; font-size: .8rem",
    )  # fmt: skip
    html.Div("{{ imported }}", v_if=("imported",), id="imported", classes="px-2", style=f"font-size: .8rem; {CARE}")
    with html.Div(classes="d-flex words", style="font-size: .8rem"):
        for side in SIDES:
            with html.Div(v_if=(f"both || side == '{side}'",), id=f"about_{side}", classes="pa-2", style="flex: 1"):
                html.B(f"Plan {side}: {{{{ about.{side}.moved }}}}")
                html.Div(f"{{{{ about.{side}.outside }}}}", style="color: #a40000")
                html.Div(f"{{{{ about.{side}.marks }}}}", style=CARE)
                html.Div(f"{{{{ about.{side}.more }}}}")
                html.Div(f"{{{{ about.{side}.overlaps }}}}")


def _legend(page) -> None:
    """The colours of the map in mm, of the lines and of the axes."""
    limit, colours = scale(page.calibration), colormaps[COLOURS](np.linspace(0, 1, 9))
    gradient = ", ".join(to_hex(colour) for colour in colours)
    level = f"{100 * page.calibration.level:g} % of a region's points should lie this near to the outcome"
    style = "gap: 0 .5rem; font-size: .72rem; flex-wrap: wrap; min-height: 3.2rem"  # two lines: the view keeps its size
    with html.Div(classes="d-flex align-center pa-1 legend", style=style):
        for name, start, most in (("displacement", "displacement: 0", MOST_MOVED), ("interval", level, limit)):
            rest = " and more" if name == "displacement" else "; skin: not judged"
            with html.Span(v_if=(f"map == '{name}'",), id=f"legend_{name}", classes="d-flex align-center",
                           style="gap: .5rem"):  # fmt: skip
                html.Span(start if name == "displacement" else f"{start}: ± 0")
                html.Span(style=f"width: 5rem; height: .9rem; background: linear-gradient(to right, {gradient})")
                html.Span(f"{most:g} mm{rest}")
        with html.Span(v_if=("shown.includes('profile')",)):
            for name, colour in PROFILE.items():
                html.B(f"— {name} ", style=f"color: {colour}")
        html.B("ghost: before", v_if=("shown.includes('ghost')",), style=f"color: {GHOST}")
        html.B("scan after surgery", v_if=("shown.includes('scan')",), style=f"color: {SCAN}")
        v3.VSpacer()
        html.Span("pivot ⬤ with axes:")
        for way, colour in AXES.items():
            html.B(f"{way} →", style=f"color: {colour}")
