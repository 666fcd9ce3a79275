"""The page of the planner: sliders on the left, the face on the right, in a browser on this machine alone."""

import asyncio
from concurrent.futures import ThreadPoolExecutor

import numpy as np
from matplotlib import colormaps
from matplotlib.colors import to_hex
from trame.app import TrameApp, asynchronous
from trame.decorators import change
from trame.ui.vuetify3 import VAppLayout
from trame.widgets import html
from trame.widgets import vtk as vtk_widgets
from trame.widgets import vuetify3 as v3

from pinnochio.errors import InputError
from pinnochio.figures.interval import scale
from pinnochio.patients.certificate import FAR, RESEARCH
from pinnochio.planner.forecast import Forecast, Forecaster
from pinnochio.planner.serving import serve
from pinnochio.planner.session import QUANTITIES, SIDES, Session
from pinnochio.planner.view import AXES, COLOURS, VIEWS, View, bone_colour
from pinnochio.plans.plan import Plan

# What a slider moves, and which way its positive end is.
LABELS = {
    "x": "left (+x), mm",
    "y": "back (+y), mm",
    "z": "up (+z), mm",
    "pitch": "pitch: front down, °",
    "roll": "roll: top to the left, °",
    "yaw": "yaw: front to the left, °",
}
SAME = 1e-6  # mm or degrees that a value of the page may be off without having been changed by the person
REACH = 20.0  # mm or degrees that a slider goes either way; farther where an opened plan does
NUMBER = "width: 4.6rem; border: 1px solid #bbb; border-radius: 4px; padding: 0 .3rem; text-align: right"
SWITCH = {"hide_details": True, "density": "compact", "color": "primary", "classes": "ml-4 flex-grow-0"}
FIELD = {"hide_details": True, "density": "compact", "variant": "outlined"}
SMALL = {"size": "small", "variant": "tonal"}
FIRST_LOOK = "first look"
OUTSIDE = "Unlike the training in {}: do not rely on the interval."
DAMPED = "Not usable: the field turned tissue inside out and was scaled to {:.2g} %; the plan is not carried out."
FAR_BEYOND = "Not usable: {:.1f} widths of the training's range beyond it."
REPAIR = "{} elements were turned inside out and solved again."


class Page(TrameApp):
    """One patient's session; predictions are made beside the page, so that it answers while one is under way."""

    def __init__(self, session: Session, forecaster: Forecaster):
        super().__init__()
        self.session, self.forecaster = session, forecaster
        self.calibration = forecaster.calibration
        self.view = View(forecaster.patient, scale(self.calibration))
        self._worker, self._following = ThreadPoolExecutor(1), False
        self._shown: dict[str, Forecast] = {}
        self._refused: dict[str, Plan] = {}
        self._images = None  # what sends the pictures, once there is a server
        self.state.update(
            {
                "trame__title": f"Planner: {session.case}",
                "side": session.side,
                "both": False,
                "interval": True,
                "bones": False,
                "segment": session.patient.segments[0],
                "plans": list(session.plans),
                "opened": None,
                "name": "",
                "said": "",
                "failed": False,
                "busy": False,
                "about": {side: {} for side in SIDES},
                "pivot": [0.0, 0.0, 0.0],
            }
            | dict.fromkeys(QUANTITIES, 0.0)
        )
        self._read_session()
        self._build()
        self.ctrl.on_server_ready.add(self._begin)

    def serve(self, port: int, browser: bool) -> None:
        """Listen on the loopback until the process is ended; port 0 for any that is free."""
        serve(self.server, port, browser)

    # What the person does.

    @change(*QUANTITIES)
    def _slide(self, **_):
        segment, before = self.state.segment, self.session.values(self.state.segment)
        for name in QUANTITIES:
            if abs(self.state[name] - before[name]) > SAME:
                self.session.change(segment, name, self.state[name])
                self._follow()

    def _type(self, name: str, text: str) -> None:
        try:
            self.session.change(self.state.segment, name, float(text))
        except ValueError:
            self._say(f"{text!r} is no number", failed=True)
            return
        self._settle()
        self._follow()

    def _type_pivot(self, axis: int, text: str) -> None:
        pivot = np.array(self.session.draft.plan.motion(self.state.segment).pivot)
        try:
            pivot[axis] = float(text)
            self.session.move_pivot(self.state.segment, pivot)
        except ValueError:
            self._say(f"{text!r} is no number", failed=True)
            return
        self._follow()

    @change("segment", "side")
    def _choose(self, **_):
        self._settle()
        self.session.side = self.state.side
        self._follow()

    @change("opened")
    def _open(self, opened, **_):
        if opened:
            self.session.open(opened)
            self.state.opened = None
            self._follow()

    def _do(self, name: str) -> None:
        if name == "stay":
            self.session.stay(self.state.segment)
        elif name == "copy":
            self.session.take_other()
        elif name == "undo":
            self.session.draft.undo()
        elif name == "redo":
            self.session.draft.redo()
        self._follow()

    def _settle(self, *_):
        """The slider is let go."""
        self.session.draft.settle()

    def _save(self) -> None:
        try:
            file, folder = self.session.save(self.state.name)
        except InputError as error:
            self._say(f"Not saved: {error.problem}. {error.remedy[0].upper()}{error.remedy[1:]}.", failed=True)
        else:
            self.state.plans = list(self.session.plans)
            self._say(f"Saved: {file} and {folder}")

    @change("both", "interval", "bones")
    def _arrange(self, both, interval, bones, **_):
        self.view.compare(both, self.session.side)
        self.view.overlay(interval, bones)
        self._draw()

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
        for _ in range(25):
            if not (self._images and self._images.last_stale_time.get(name)):
                return
            await asyncio.sleep(0.02)
            self._images.push_render(name)

    def _say(self, text: str, failed: bool = False) -> None:
        self.state.said, self.state.failed = text, failed

    def _read_session(self) -> None:
        """Show the edited plan's numbers."""
        values = self.session.values(self.state.segment)
        motion = self.session.draft.plan.motion(self.state.segment)
        draft = self.session.draft
        self.state.update({"can_undo": draft.can_undo, "can_redo": draft.can_redo})
        for name, value in values.items():
            if abs(self.state[name] - value) > SAME:  # a slider that is being dragged is left alone
                self.state[name] = value
        self.state.pivot = [round(value, 2) for value in motion.pivot.tolist()]
        self.state.reach = max(REACH, *(float(np.ceil(abs(value))) for value in values.values()))
        self.view.mark(self.session.side, motion.pivot + motion.translation)
        self.view.compare(self.state.both, self.session.side)

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
                            self._show(side, forecast)
                except (FloatingPointError, InputError) as error:
                    self._refused[side] = plan
                    with self.state:
                        self._say(f"Plan {side} cannot be predicted: {error}", failed=True)
        finally:
            with self.state:
                self._following = self.state.busy = False

    def _show(self, side: str, forecast: Forecast) -> None:
        self._shown[side] = forecast
        self.view.show(side, forecast)
        with self.state:
            self.state.about = self.state.about | {side: self._about(forecast)}
        self._draw()

    def _behind(self, side: str) -> bool:
        """Whether a side shows another plan than stands in the session, or a first look at it."""
        plan, shown = self.session.drafts[side].plan, self._shown.get(side)
        if self._refused.get(side) is plan:
            return False
        return shown is None or shown.plan is not plan or shown.least is None

    def _about(self, forecast: Forecast) -> dict:
        """A forecast in words."""
        half_width = forecast.interval.half_width
        words = f"interval ± {np.nanmedian(half_width):.2f} mm median, {np.nanmax(half_width):.2f} mm at most; "
        words += FIRST_LOOK if forecast.least is None else f"smallest volume ratio {forecast.least:.2f}"
        return {
            "moved": f"face moves {forecast.mean:.2f} mm in the mean, {forecast.most:.2f} mm at most",
            "more": f"{words}; after {forecast.seconds:.2f} s",
            "outside": _warning(forecast),
        }

    # What the page looks like.

    def _build(self) -> None:
        with VAppLayout(self.server) as layout:
            self.ui = layout
            with v3.VAppBar(density="compact", flat=True, border=True):
                v3.VAppBarTitle(f"Planner: {self.session.case}", style="max-width: 15rem")
                with v3.VBtnToggle(v_model=("side",), mandatory=True, density="compact", divided=True, color="primary"):
                    for side in SIDES:
                        v3.VBtn(f"Plan {side}", value=side, id=f"side_{side}")
                v3.VSwitch(v_model=("both",), label="side by side", **SWITCH)
                v3.VSwitch(v_model=("interval",), label="interval", **SWITCH)
                v3.VSwitch(v_model=("bones",), label="bones", **SWITCH)
                for name, icon, enabled in (("undo", "mdi-undo", "can_undo"), ("redo", "mdi-redo", "can_redo")):
                    v3.VBtn(icon=icon, id=name, title=name, disabled=(f"!{enabled}",), click=(self._do, f"['{name}']"))
                v3.VSpacer()
                for view in VIEWS:
                    v3.VBtn(view, size="small", variant="text", click=(self._look, f"['{view}']"))
                v3.VProgressLinear(id="busy", v_if=("busy",), indeterminate=True, absolute=True, location="bottom")
            with v3.VNavigationDrawer(permanent=True, width=340), html.Div(classes="pa-3"):
                self._build_segment()
                v3.VDivider(classes="my-3")
                self._build_files()
            with v3.VMain(classes="d-flex flex-column", style="height: 100vh"):
                self._build_captions()
                self._remote = vtk_widgets.VtkRemoteView(
                    self.view.plotter.render_window, interactive_ratio=1, interactive_quality=70,
                    style="flex: 1; min-height: 0",
                )  # fmt: skip
                self._build_legend()

    def _build_segment(self) -> None:
        """Which segment moves, how far, and about which point."""
        with v3.VChipGroup(v_model=("segment",), mandatory=True, column=True):
            for index, name in enumerate(self.session.patient.segments):
                with v3.VChip(value=name, id=f"segment_{name}", filter=True, size="small"):
                    html.Span("⬤", style=f"color: {bone_colour(index)}; margin-right: .4em")
                    html.Span(name)
        for name, label in LABELS.items():
            with html.Div(classes="d-flex justify-space-between align-center mt-1"):
                html.Label(label, style="font-size: .85rem")
                html.Input(
                    value=(f"{name}.toFixed(1)",), id=f"number_{name}", type="number", step=0.1, style=NUMBER,
                    change=(self._type, f"['{name}', $event.target.value]"),
                )  # fmt: skip
            v3.VSlider(
                v_model=(name,), min=("-reach",), max=("reach",), step=0.1, id=f"slider_{name}", hide_details=True,
                density="compact", color="primary", end=self._settle, aria_label=label,
            )  # fmt: skip
        with html.Div(classes="d-flex align-center mt-2", style="font-size: .85rem; gap: .3rem"):
            html.Span("turns about")
            for axis, name in enumerate("xyz"):
                html.Input(
                    value=(f"pivot[{axis}]",), id=f"pivot_{name}", type="number", step=1, style=NUMBER,
                    change=(self._type_pivot, f"[{axis}, $event.target.value]"),
                )  # fmt: skip
        v3.VBtn(
            "Leave this segment in place", id="stay", block=True, classes="mt-2", **SMALL, click=(self._do, "['stay']")
        )

    def _build_files(self) -> None:
        """Opening, copying and saving plans."""
        v3.VSelect(v_model=("opened",), items=("plans",), label="Open a plan", id="open", **FIELD)
        v3.VBtn(
            "Take over the plan of the other side", id="copy", block=True, classes="my-2", **SMALL,
            click=(self._do, "['copy']"),
        )  # fmt: skip
        v3.VTextField(v_model=("name",), label="Name to save it under", id="name", **FIELD)
        v3.VBtn("Save", id="save", block=True, color="primary", classes="mt-2", disabled=("!name",), click=self._save)
        v3.VAlert(
            "{{ said }}", v_if=("said",), id="said", type=("failed ? 'error' : 'success'",), density="compact",
            classes="mt-2", style="overflow-wrap: anywhere; font-size: .8rem",
        )  # fmt: skip
        html.P(RESEARCH, classes="mt-3 text-caption")

    def _build_captions(self) -> None:
        """What is shown of each plan, in words above its picture."""
        with html.Div(classes="d-flex", style="font-size: .85rem"):
            for side in SIDES:
                with html.Div(v_if=(f"both || side == '{side}'",), id=f"about_{side}", classes="pa-2", style="flex: 1"):
                    html.B(f"Plan {side}: {{{{ about.{side}.moved }}}}")
                    html.Div(f"{{{{ about.{side}.more }}}}")
                    html.Div(f"{{{{ about.{side}.outside }}}}", style="color: #a40000")

    def _build_legend(self) -> None:
        """The colours of the half-width in mm, and those of the axes."""
        limit, colours = scale(self.calibration), colormaps[COLOURS](np.linspace(0, 1, 9))
        gradient = ", ".join(to_hex(colour) for colour in colours)
        with html.Div(classes="d-flex align-center pa-2", style="gap: .5rem; font-size: .85rem; flex-wrap: wrap"):
            with html.Span(v_if=("interval",), id="legend", classes="d-flex align-center", style="gap: .5rem"):
                html.Span(f"half-width of the {100 * self.calibration.level:g} % interval: 0")
                html.Span(style=f"width: 10rem; height: .9rem; background: linear-gradient(to right, {gradient})")
                html.Span(f"{limit:g} mm; skin-coloured: not judged")
            v3.VSpacer()
            html.Span("pivot ⬤ with axes:")
            for way, colour in AXES.items():
                html.B(f"{way} →", style=f"color: {colour}")


def _warning(forecast: Forecast) -> str:
    """What speaks against a forecast, in words; empty where nothing does."""
    said = []
    if forecast.damping < 1:
        said.append(DAMPED.format(100 * forecast.damping))
    elif forecast.repaired:
        said.append(REPAIR.format(forecast.repaired))
    if forecast.beyond > FAR:
        said.append(FAR_BEYOND.format(forecast.beyond))
    if forecast.out_of_distribution:
        said.append(OUTSIDE.format(", ".join(forecast.out_of_distribution)))
    return " ".join(said)
