"""The page of the planner: bones on the left, the face in the middle, numbers on the right; on this machine alone."""

import asyncio
import functools
from concurrent.futures import ThreadPoolExecutor

import numpy as np
from matplotlib import colormaps
from matplotlib.colors import to_hex
from trame.app import TrameApp, asynchronous
from trame.decorators import change
from trame.ui.vuetify3 import VAppLayout
from trame.widgets import client, html
from trame.widgets import vtk as vtk_widgets
from trame.widgets import vuetify3 as v3

from pinnochio.errors import InputError, StorageError
from pinnochio.figures.interval import scale
from pinnochio.inverse.freedom import operation_in_words
from pinnochio.metrics.validity import OFF_BONE
from pinnochio.model.measures import MEASURES
from pinnochio.patients.certificate import FAR, RESEARCH
from pinnochio.patients.face import FaceMeasures, written
from pinnochio.planner.forecast import Forecast, Forecaster
from pinnochio.planner.jaws import named
from pinnochio.planner.serving import serve
from pinnochio.planner.session import SIDES, Session
from pinnochio.planner.view import (
    AXES,
    COLOURS,
    GHOST,
    MAPS,
    MOST_MOVED,
    PROFILE,
    SCAN,
    VIEWS,
    FaceView,
    bone_colour,
)
from pinnochio.planner.wishing import Fit, Wishing
from pinnochio.plans.plan import Plan
from pinnochio.plans.surgery import AMOUNTS, amount, segment_in_words

SAME = 1e-6  # mm or degrees that a value of the page may be off without having been changed by the person
REACH = 20.0  # mm or degrees that a slider goes either way; farther where an opened plan does
NUMBER = (
    "width: 4rem; border: 1px solid #bbb; border-radius: 4px; padding: 0 .3rem; text-align: right; font-size: .8rem"
)
WISHED = NUMBER.replace("4rem", "3.2rem").replace(".8rem", ".72rem")
SWITCH = {"hide_details": True, "density": "compact", "color": "primary"}
FIELD = {"hide_details": True, "density": "compact", "variant": "outlined"}
SMALL = {"size": "small", "variant": "tonal"}
SHOWN = {"bones": "bones", "ghost": "before (ghost)", "profile": "profile", "midline": "midline", "scan": "scan"}
AT_FIRST = ["profile"]
FIRST_LOOK = "first look"
OUTSIDE = "Unlike the training in {}: do not rely on the interval."
DAMPED = "Not usable: the field turned tissue inside out and was scaled to {:.2g} %; the plan is not carried out."
OFF = "Not usable: tissue that slides is {:.1f} mm off its bone, beyond its rim."
FAR_BEYOND = "Not usable: {:.1f} widths of the training's range beyond it."
REPAIR = "{} elements were turned inside out and solved again."
COLLIDE = "Bones run into each other: {} (up to {:.1f} mm deep; red points)."
PRACTICE = "Beyond what is practised: {}."
STILL = "Nothing is moved, so nothing changes."
NARROWEST = 900  # pixels of a window; below it the page says a sentence
PHONE = "The planner needs a window at least {} pixels wide, such as that of a laptop. Open it there."
STYLE = f"""
* {{ transition: none !important; animation: none !important }}
#phone {{ display: none; padding: 2rem; font-size: 1.1rem }}
@media (max-width: {NARROWEST - 1}px) {{
  #phone {{ display: block; position: fixed; inset: 0; z-index: 5000; background: white }}
}}
.numbers {{ border-collapse: collapse; width: 100% }}
.numbers td, .numbers th {{ padding: .08rem .3rem; text-align: right; white-space: nowrap; font-size: .74rem }}
.numbers td:first-child, .numbers th:first-child {{ text-align: left; white-space: normal }}
.numbers tr:nth-child(even) {{ background: #f5f5f5 }}
.v-slider.v-input--horizontal {{ margin-top: -8px; margin-bottom: -8px }}
.v-navigation-drawer .v-switch .v-label {{ font-size: .78rem }}
.v-navigation-drawer .v-switch .v-selection-control {{ min-height: 28px }}
.far {{ color: #b26a00; font-weight: bold }}
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
  const ids = { a: 'side_A', b: 'side_B', r: 'reset', f: 'look_front', o: 'look_oblique', p: 'look_left' };
  if (ids[key]) click(ids[key]);
  else if (/^[1-9]$/.test(key)) {
    const chips = document.querySelectorAll('[id^=segment_]');
    if (chips[key - 1]) chips[key - 1].click();
  }
});
"""
HELP = "Keys: 1-9 bone, arrows on a slider, Ctrl+Z / Ctrl+Y, R reset, A / B plan, F front, O oblique, P profile"


def answered(method):
    """What the person does, or a program in the person's name: a value that nobody can use is answered by words."""

    @functools.wraps(method)
    def tried(self, *args, **kwargs):
        try:
            return method(self, *args, **kwargs)
        except InputError as error:
            said = f"{error.problem}. {error.remedy[0].upper()}{error.remedy[1:]}."
        except (ValueError, KeyError, TypeError, StorageError, OSError) as error:
            said = f"{error}"
        self._read_session()
        self._say(f"Not done: {said[:300]}", failed=True)
        return None

    return tried


class Page(TrameApp):
    """One patient's session; predictions are made beside the page, so that it answers while one is under way.

    scan: points (k, 3) mm and faces of the post-operative skin, where there is one.
    """

    def __init__(self, session: Session, forecaster: Forecaster, wishing: Wishing, scan: tuple | None = None):
        super().__init__()
        self.session, self.forecaster, self.wishing = session, forecaster, wishing
        self.calibration = forecaster.calibration
        self.face = FaceMeasures(forecaster.patient)
        middle = float(self.face.landmarks.positions[0, 0])
        self.view = FaceView(forecaster.patient, scale(self.calibration), middle, scan)
        self._worker, self._following = ThreadPoolExecutor(1), False
        self._seeker, self._seeking = ThreadPoolExecutor(1), False  # its finite elements take seconds
        self._shown: dict[str, Forecast] = {}
        self._refused: dict[str, Plan] = {}
        self._images = None  # what sends the pictures, once there is a server
        self._seen = {name: words for name, words in SHOWN.items() if name != "scan" or scan is not None}
        self.state.update(
            {
                "trame__title": f"Planner: {session.case}",
                "side": session.side,
                "both": False,
                "map": MAPS[0],
                "shown": AT_FIRST,
                "numbers": True,
                "carry": session.carry,
                "locked": session.locked,
                "segment": session.patient.segments[0],
                "plans": list(session.plans),
                "opened": None,
                "preset": None,
                "name": "",
                "said": "",
                "failed": False,
                "busy": False,
                "about": {side: {} for side in SIDES},
                "rows": {side: {"measures": [], "landmarks": []} for side in SIDES},
                "pivot": [0.0, 0.0, 0.0],
                "labels": {},
                "far": [],
                "reach": REACH,
                "wishes": {},
                "operation": next(iter(wishing.operations), None),
                "seeking": False,
            }
            | dict.fromkeys(AMOUNTS, 0.0)
        )
        self._read_session()
        self._build()
        self.view.overlay(MAPS[0], AT_FIRST)
        self.ctrl.on_server_ready.add(self._begin)

    def serve(self, port: int, browser: bool) -> None:
        """Listen on the loopback until the process is ended; port 0 for any that is free."""
        serve(self.server, port, browser)

    # What the person does.

    @change(*AMOUNTS)
    @answered
    def _slide(self, **_):
        segment, before = self.state.segment, self.session.values(self.state.segment)
        for name in AMOUNTS:
            if self._differs(name, before[name]):
                self.session.change(segment, name, self.state[name])
                self._follow()

    @answered
    def _type(self, name: str, text: str) -> None:
        self.session.change(self.state.segment, name, _number(text))
        self._settle()
        self._follow()

    @answered
    def _type_pivot(self, axis: int, text: str) -> None:
        pivot = np.array(self.session.draft.plan.motion(self.state.segment).pivot)
        pivot[axis] = _number(text)
        self.session.move_pivot(self.state.segment, pivot)
        self._follow()

    @change("segment", "side")
    @answered
    def _choose(self, segment, side, **_):
        self._settle()
        if segment not in self.session.patient.segments:
            self.state.segment = self.session.patient.segments[0]
        if side not in SIDES:
            self.state.side = self.session.side
        self.session.values(segment)  # ValueError where there is no such segment
        self.session.choose(side)
        self._follow()

    @change("opened", "preset")
    @answered
    def _open(self, opened, preset, **_):
        self.state.opened = self.state.preset = None
        if opened:
            self.session.open(opened)
        if preset:
            self.session.preset(preset)
        if opened or preset:
            self._follow()

    @change("carry", "locked")
    def _hold(self, carry, locked, **_):
        self.session.carry, self.session.locked = bool(carry), bool(locked)

    @answered
    def _do(self, name: str) -> None:
        if name == "stay":
            self.session.stay(self.state.segment)
        elif name == "copy":
            self.session.take_other()
        elif name == "reset":
            self.session.reset()
        elif name == "occlude":
            self.session.occlude()
        elif name == "undo":
            self.session.draft.undo()
        elif name == "redo":
            self.session.draft.redo()
        self._follow()

    @answered
    def _wish(self, name: str, text: str) -> None:
        """A measure is wished to be so, or, without a number, no longer."""
        wishes = {measure: value for measure, value in self.state.wishes.items() if measure != name}
        if str(text).strip():
            wishes[name] = self.wishing.wish(str(name), _number(text)).target
        self.state.wishes = wishes

    @answered
    def _fit(self) -> None:
        if not self._seeking:
            fits = self.wishing.fits(dict(self.state.wishes), self.state.operation)
            self._seeking = self.state.seeking = True
            self._say("A plan is sought for the wished face ...")
            asynchronous.create_task(self._seek(self.session.side, fits))

    def _settle(self, *_):
        """The slider is let go."""
        self.session.draft.settle()

    @answered
    def _save(self) -> None:
        file, folder = self.session.save(self.state.name)
        self.state.plans = list(self.session.plans)
        self._say(f"Saved: {file} and {folder}")

    @change("both", "map", "shown")
    @answered
    def _arrange(self, both, map, shown, **_):
        self.view.compare(bool(both), self.session.side)
        self.view.overlay(map, [str(name) for name in shown or ()])
        self._draw()

    @answered
    def _look(self, view: str) -> None:
        self.view.look(view)
        self._draw()

    # What the page does.

    def _begin(self, **_):
        self._images = next(part for part in self.server.protocol.getLinkProtocols() if hasattr(part, "push_render"))
        self._follow()

    def _draw(self) -> None:
        """Render and send the picture."""
        self._remote.update()
        asynchronous.create_task(self._send())

    async def _send(self) -> None:
        """Send the picture as soon as it is encoded; the view itself would look for it after half a second."""
        name = self.state[f"{self._remote.ref_name}Id"]
        for _ in range(100):
            if not (self._images and self._images.last_stale_time.get(name)):
                return
            await asyncio.sleep(0.005)
            self._images.push_render(name)

    def _say(self, text: str, failed: bool = False) -> None:
        self.state.said, self.state.failed = text, failed

    def _differs(self, name: str, value: float) -> bool:
        """Whether the page has another value than the session."""
        shown = self.state[name]
        return isinstance(shown, bool) or not isinstance(shown, int | float) or not abs(shown - value) <= SAME

    def _read_session(self) -> None:
        """Show the edited plan's numbers."""
        segment = self.state.segment
        if segment not in self.session.patient.segments:
            segment = self.state.segment = self.session.patient.segments[0]
        values, draft = self.session.values(segment), self.session.draft
        motion = draft.plan.motion(segment)
        self.state.update({"can_undo": draft.can_undo, "can_redo": draft.can_redo})
        for name, value in values.items():
            if self._differs(name, value):  # a slider that is being dragged is left alone
                self.state[name] = value
        self.state.labels = {name: _label(name, segment) for name in AMOUNTS}
        self.state.far = self.session.jaws.beyond(draft.plan).get(segment, [])
        self.state.pivot = [round(value, 2) + 0.0 for value in motion.pivot.tolist()]  # no -0
        self.state.reach = max(REACH, *(float(np.ceil(abs(value))) for value in values.values()))
        self.view.mark(self.session.side, motion.pivot + motion.translation)
        self.view.compare(bool(self.state.both), self.session.side)

    def _follow(self) -> None:
        """Show the session as it stands now; its forecasts as soon as they are made."""
        self._read_session()
        self._say("")
        if not self._following:
            self._following = self.state.busy = True
            asynchronous.create_task(self._forecast())

    async def _forecast(self) -> None:
        """Forecast both plans until what is shown is what stands in the session; what came between is left out."""
        loop = asyncio.get_running_loop()
        try:
            while behind := [side for side in SIDES if self._behind(side)]:
                side = self.session.side if self.session.side in behind else behind[0]
                plan = self.session.drafts[side].plan
                steps, forecast = self.forecaster.steps(plan), None
                try:
                    while forecast is not False and plan is self.session.drafts[side].plan:
                        if forecast := await loop.run_in_executor(self._worker, next, steps, False):
                            await self._show(side, forecast)
                except (FloatingPointError, InputError) as error:
                    self._refused[side] = plan
                    with self.state:
                        self._say(f"Plan {side} cannot be predicted: {error}", failed=True)
        finally:
            with self.state:
                self._following = self.state.busy = False

    async def _seek(self, side: str, fits) -> None:
        """Put what is found in place: by the elastic map, then by finite elements, unless the person has gone on."""
        loop, plan = asyncio.get_running_loop(), self.session.drafts[side].plan
        try:
            while fit := await loop.run_in_executor(self._seeker, next, fits, None):
                with self.state:
                    if self.session.side != side or self.session.draft.plan is not plan:
                        return
                    self.session.take(fit.plan)
                    plan = self.session.draft.plan
                    self._follow()
                    self._say(_fitted(fit))
        except (ValueError, KeyError, TypeError, FloatingPointError) as error:
            with self.state:
                self._say(f"Not done: {error}", failed=True)
        finally:
            with self.state:
                self._seeking = self.state.seeking = False

    async def _show(self, side: str, forecast: Forecast) -> None:
        """Show a forecast, and wait until its picture is sent, so that what comes next does not hold it up."""
        self._shown[side] = forecast
        deep, places = self.session.jaws.collisions(forecast.plan)
        self.view.show(side, forecast, places)
        self._remote.update()  # the picture is encoded while the words are made
        with self.state:
            self.state.about = self.state.about | {side: self._about(forecast, deep)}
            self.state.rows = self.state.rows | {side: self._rows(forecast)}
        await self._send()

    def _behind(self, side: str) -> bool:
        """Whether a side shows another plan than stands in the session, or a first look at it."""
        plan, shown = self.session.drafts[side].plan, self._shown.get(side)
        if self._refused.get(side) is plan:
            return False
        return shown is None or shown.plan is not plan or shown.least is None

    def _about(self, forecast: Forecast, deep: dict) -> dict:
        """A forecast in words."""
        half_width = forecast.interval.half_width
        level = f"{100 * self.calibration.level:g} % interval"
        words = f"{level} ± {np.nanmedian(half_width):.2f} mm median, {np.nanmax(half_width):.2f} mm at most; "
        words += FIRST_LOOK if forecast.least is None else f"smallest volume ratio {forecast.least:.2f}"
        marks = [COLLIDE.format(named(list(deep)), max(deep.values()))] if deep else []
        if far := self.session.jaws.beyond(forecast.plan):
            said = (f"{segment_in_words(name)} {_word(part, name)}" for name, parts in far.items() for part in parts)
            marks.append(PRACTICE.format(", ".join(said)))
        moved = f"face moves {forecast.mean:.2f} mm in the mean, {forecast.most:.2f} mm at most"
        return {
            "moved": f"{moved}. {STILL}" if forecast.plan.still else moved,
            "more": f"{words}; after {forecast.seconds:.2f} s",
            "outside": _warning(forecast),
            "marks": " ".join(marks),
        }

    def _rows(self, forecast: Forecast) -> dict:
        """The measures of a forecast, and the displacements of landmarks, as the tables show them."""
        half_width = None if forecast.plan.still else forecast.interval.half_width
        measures, moved = [], {}
        for row in self.face.rows(forecast.interval.displacement, half_width):
            if row.name in MEASURES:
                digits = 0 if row.unit == "degree" else 1
                numbers = {"before": written(row.before, digits), "after": written(row.after, digits)}
                numbers |= {"change": written(row.change, 1, "+"), "half": written(row.half_width, 1)}
                unit = "°" if row.unit == "degree" else "mm"
                measures.append({"name": row.name, "title": f"{row.title}, {unit}"} | numbers)
            else:
                row_of = moved.setdefault(row.title, {"title": row.title, "half": written(row.half_width, 1)})
                row_of[row.positive.split()[-1]] = written(row.change, 1, "+")
        return {"measures": measures, "landmarks": list(moved.values())}

    # What the page looks like.

    def _build(self) -> None:
        with VAppLayout(self.server) as layout:
            self.ui = layout
            client.Style(STYLE)
            client.Script(KEYS)
            html.Div(PHONE.format(NARROWEST), id="phone")
            self._build_bar()
            with v3.VNavigationDrawer(permanent=True, width=296), html.Div(classes="pa-2"):
                self._build_segment()
                v3.VDivider(classes="my-2")
                self._build_files()
            with v3.VNavigationDrawer(v_model=("numbers",), location="right", width=400, permanent=True):
                self._build_measures()
            with v3.VMain(classes="d-flex flex-column", style="height: 100vh"):
                self._build_captions()
                self._remote = vtk_widgets.VtkRemoteView(
                    self.view.plotter.render_window, interactive_ratio=1, interactive_quality=70,
                    style="flex: 1; min-height: 0",
                )  # fmt: skip
                self._build_legend()

    def _build_bar(self) -> None:
        """Plans, what is seen, and from where."""
        with v3.VAppBar(density="compact", flat=True, border=True):
            html.B(self.session.case, classes="ml-3 mr-2", style="white-space: nowrap")
            toggle = {"mandatory": True, "density": "compact", "divided": True, "color": "primary"}
            with v3.VBtnToggle(v_model=("side",), **toggle):
                for side in SIDES:
                    v3.VBtn(f"Plan {side}", value=side, id=f"side_{side}", size="small")
            v3.VSwitch(v_model=("both",), label="both", id="both", classes="ml-3 flex-grow-0", **SWITCH)
            for name, icon, enabled in (("undo", "mdi-undo", "can_undo"), ("redo", "mdi-redo", "can_redo")):
                v3.VBtn(
                    icon=icon, id=name, title=f"{name} (Ctrl+{'Z' if name == 'undo' else 'Y'})", size="small",
                    disabled=(f"!{enabled}",), click=(self._do, f"['{name}']"),
                )  # fmt: skip
            v3.VBtn("reset", id="reset", title="move nothing (R)", variant="text", size="small",
                    click=(self._do, "['reset']"))  # fmt: skip
            v3.VSpacer()
            v3.VSelect(
                v_model=("shown",), items=("seen", [{"title": words, "value": name} for name, words in
                                                    self._seen.items()]),
                multiple=True, label="show", id="shown", style="max-width: 13rem", **FIELD,
            )  # fmt: skip
            with v3.VBtnToggle(v_model=("map",), classes="ml-2", **toggle):
                for name in MAPS:
                    v3.VBtn({"none": "no map"}.get(name, name), value=name, id=f"map_{name}", size="small")
            for view in VIEWS:
                v3.VBtn(
                    {"left": "profile"}.get(view, view), id=f"look_{view}", size="small", variant="text",
                    min_width=0, classes="px-2", click=(self._look, f"['{view}']"),
                )  # fmt: skip
            v3.VBtn("numbers", id="numbers", size="small", variant="text", click="numbers = !numbers")
            v3.VProgressLinear(id="busy", v_if=("busy",), model_value=100, absolute=True, location="bottom")

    def _build_segment(self) -> None:
        """Which segment moves, how far, and about which point."""
        v3.VSelect(
            v_model=("preset",), items=("presets", self.session.presets), label="Start from", id="preset", **FIELD
        )
        with v3.VChipGroup(v_model=("segment",), mandatory=True, column=True):
            for index, name in enumerate(self.session.patient.segments):
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
                    change=(self._type, f"['{name}', $event.target.value]"),
                )  # fmt: skip
            v3.VSlider(
                v_model=(name,), min=("-reach",), max=("reach",), step=0.1, id=f"slider_{name}", hide_details=True,
                density="compact", color=(f"far.includes('{name}') ? 'warning' : 'primary'",), end=self._settle,
                aria_label=name,
            )  # fmt: skip
        with html.Div(classes="d-flex align-center mt-1", style="font-size: .78rem; gap: .3rem"):
            html.Span("turns about")
            for axis, name in enumerate("xyz"):
                html.Input(
                    value=(f"pivot[{axis}]",), id=f"pivot_{name}", type="number", step=1, style=NUMBER,
                    change=(self._type_pivot, f"[{axis}, $event.target.value]"),
                )  # fmt: skip
        if self.session.jaws.rami or self.session.jaws.chin:
            v3.VSwitch(v_model=("carry",), label="mandible carries rami and chin", id="carry", **SWITCH)
        if self.session.jaws.upper and self.session.jaws.lower:
            v3.VSwitch(v_model=("locked",), label="keep the occlusion (jaws locked)", id="locked", **SWITCH)
            v3.VBtn(
                "Final occlusion", id="occlude", block=True, title=self.session.occlusion, classes="my-1", **SMALL,
                click=(self._do, "['occlude']"),
            )  # fmt: skip
        v3.VBtn("Leave this segment in place", id="stay", block=True, **SMALL, click=(self._do, "['stay']"))

    def _build_files(self) -> None:
        """Opening, copying and saving plans."""
        v3.VSelect(v_model=("opened",), items=("plans",), label="Open a plan", id="open", **FIELD)
        v3.VBtn(
            "Take over the other plan", id="copy", block=True, classes="my-2", **SMALL, click=(self._do, "['copy']")
        )
        with html.Div(classes="d-flex", style="gap: .4rem"):
            v3.VTextField(v_model=("name",), label="Save as", id="name", maxlength=64, **FIELD)
            v3.VBtn("Save", id="save", color="primary", disabled=("!name",), click=self._save)
        html.P(f"{HELP}. {RESEARCH}", classes="mt-2 text-caption")

    def _build_measures(self) -> None:
        """Before, after, change and interval of the measures, of one plan or of both."""
        level = f"{100 * self.calibration.level:g} %"
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
                        id=("'wish_' + row.name",), change=(self._wish, "[row.name, $event.target.value]"),
                    )  # fmt: skip
        with html.Div(classes="d-flex pa-2", style="gap: .4rem", v_if=("!both && operation",)):
            words = [{"title": operation_in_words(name), "value": name} for name in self.wishing.operations]
            v3.VSelect(
                v_model=("operation",), items=("operations", words), label="move", id="operation",
                style="min-width: 9rem", **FIELD,
            )  # fmt: skip
            v3.VBtn(
                "Fit the plan", id="fit", color="primary", click=self._fit, loading=("seeking",),
                disabled=("!Object.keys(wishes).length",), title="seeks the least motion that meets the wished values",
            )  # fmt: skip
        with html.Table(id="landmarks", classes="numbers mt-2"):
            with html.Tr():
                for title in ("{{ side }}: moves by, mm", "forward", "up", "left", f"± {level}"):
                    html.Th(title)
            with html.Tr(v_for="row in rows[side].landmarks", key="row.title"):
                for name in ("title", "forward", "up", "left", "half"):
                    html.Td(f"{{{{ row.{name} }}}}")
        html.P(
            f"±: from the {level} intervals at the landmarks, taken as independent; not calibrated by itself. "
            "E-line, N' vertical: + in front. –: cannot be read on this face.",
            classes="text-caption pa-2",
        )

    def _build_captions(self) -> None:
        """What was done or refused, and what is shown of each plan, in words above its picture."""
        v3.VAlert(
            "{{ said }}", v_if=("said",), id="said", type=("failed ? 'error' : 'success'",), density="compact",
            style="flex: none; overflow-wrap: anywhere; font-size: .8rem",
        )  # fmt: skip
        with html.Div(classes="d-flex", style="font-size: .8rem"):
            for side in SIDES:
                with html.Div(v_if=(f"both || side == '{side}'",), id=f"about_{side}", classes="pa-2", style="flex: 1"):
                    html.B(f"Plan {side}: {{{{ about.{side}.moved }}}}")
                    html.Div(f"{{{{ about.{side}.more }}}}")
                    html.Div(f"{{{{ about.{side}.outside }}}}", style="color: #a40000")
                    html.Div(f"{{{{ about.{side}.marks }}}}", style="color: #b26a00")

    def _build_legend(self) -> None:
        """The colours of the map in mm, of the lines and of the axes."""
        limit, colours = scale(self.calibration), colormaps[COLOURS](np.linspace(0, 1, 9))
        gradient = ", ".join(to_hex(colour) for colour in colours)
        level = f"{100 * self.calibration.level:g} % of a region's points should lie this near to the outcome"
        style = (
            "gap: 0 .5rem; font-size: .72rem; flex-wrap: wrap; min-height: 3.2rem"  # two lines: the view keeps its size
        )
        with html.Div(classes="d-flex align-center pa-1", style=style):
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


def _fitted(fit: Fit) -> str:
    """What was found for a wish, in words."""
    by = "Finite elements" if fit.verified else "Proposal by the elastic map, which finite elements now verify"
    off = [f"{MEASURES[name].title} by {error:.1f}" for name, error in fit.missed.items() if not error <= fit.met]
    return f"{by}: " + (f"missed are {', '.join(off)} (mm or degrees)." if off else "every wish is met.")


def _number(text: object) -> float:
    try:
        return float(text)
    except (TypeError, ValueError):
        raise ValueError(f"{str(text)[:40]!r} is no number") from None


def _label(name: str, segment: str) -> str:
    """What a slider moves, and which way its positive end is."""
    part = amount(name, segment)
    title, less = (f"{name}: ", part.less.split()[-1]) if part.unit == "°" else ("", part.less)
    return f"{title}{part.more} (+) / {less} (−), {part.unit}"


def _word(name: str, segment: str) -> str:
    part = amount(name, segment)
    return name if part.unit == "°" else f"{part.more} / {part.less}"


def _warning(forecast: Forecast) -> str:
    """What speaks against a forecast, in words; empty where nothing does."""
    said = []
    if forecast.damping < 1:
        said.append(DAMPED.format(100 * forecast.damping))
    elif forecast.repaired:
        said.append(REPAIR.format(forecast.repaired))
    if not forecast.off_bone <= OFF_BONE:
        said.append(OFF.format(forecast.off_bone))
    if forecast.beyond > FAR:
        said.append(FAR_BEYOND.format(forecast.beyond))
    if forecast.out_of_distribution:
        said.append(OUTSIDE.format(", ".join(forecast.out_of_distribution)))
    return " ".join(said)
