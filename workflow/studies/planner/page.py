"""The page of the planner, on this machine alone: what the person does, and what is shown after it."""

import asyncio
import functools
from concurrent.futures import ThreadPoolExecutor

import numpy as np
from trame.app import TrameApp, asynchronous
from trame.decorators import change

from pinnochio.errors import InputError, StorageError
from pinnochio.model.measures import LANDMARKS
from pinnochio.patients.face_measures import FaceMeasures
from pinnochio.plans.plan import Plan
from pinnochio.plans.surgery import AMOUNTS
from studies.planner.forecast import Forecast, Forecaster
from studies.planner.page_layout import build
from studies.planner.page_words import about, fitted, import_in_words, label, rows
from studies.planner.serving import serve
from studies.planner.session import SIDES, Session
from studies.planner.view import MAPS, FaceView, scale
from studies.planner.wishing import Wishing

SAME = 1e-6  # mm or degrees that a value of the page may be off without having been changed by the person
REACH = 20.0  # mm or degrees that a slider goes either way; farther where an opened plan does
SHOWN = {"bones": "bones", "ghost": "before (ghost)", "profile": "profile", "midline": "midline", "scan": "scan"}
AT_FIRST = ["profile"]


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
        middle = float(self.face.landmarks.positions[LANDMARKS.index("subnasale"), 0])
        self.view = FaceView(forecaster.patient, scale(self.calibration), middle, scan)
        self._worker, self._following = ThreadPoolExecutor(1), False
        self._seeker, self._seeking = ThreadPoolExecutor(1), False  # its finite elements take seconds
        self._shown: dict[str, Forecast] = {}
        self._refused: dict[str, Plan] = {}
        self._images = None  # what sends the pictures, once there is a server
        self.seen = {name: words for name, words in SHOWN.items() if name != "scan" or scan is not None}
        self.state.update(
            {
                "trame__title": f"Planner: {session.case}",
                "side": session.side,
                "both": False,
                "map": MAPS[0],
                "shown": AT_FIRST,
                "numbers": True,
                "traced": False,
                "imported": import_in_words(forecaster.imported),
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
                "rows": {side: {"measures": [], "landmarks": [], "bone": [], "tracing": ""} for side in SIDES},
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
        self.remote = build(self)
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
    def enter(self, name: str, text: str) -> None:
        self.session.change(self.state.segment, name, _number(text))
        self.settle()
        self._follow()

    @answered
    def enter_pivot(self, axis: int, text: str) -> None:
        pivot = np.array(self.session.draft.plan.motion(self.state.segment).pivot)
        pivot[axis] = _number(text)
        self.session.move_pivot(self.state.segment, pivot)
        self._follow()

    @change("segment", "side")
    @answered
    def _choose(self, segment, side, **_):
        self.settle()
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
    def do(self, name: str) -> None:
        """What a button says; KeyError for another name."""
        session, draft = self.session, self.session.draft
        buttons = {"copy": session.take_other, "reset": session.reset, "occlude": session.occlude}
        buttons |= {"undo": draft.undo, "redo": draft.redo, "stay": lambda: session.stay(self.state.segment)}
        buttons[name]()
        self._follow()

    @answered
    def wish(self, name: str, text: str) -> None:
        """A measure is wished to be so, or, without a number, no longer."""
        wishes = {measure: value for measure, value in self.state.wishes.items() if measure != name}
        if str(text).strip():
            wishes[name] = self.wishing.wish(str(name), _number(text)).target
        self.state.wishes = wishes

    @answered
    def fit(self) -> None:
        if not self._seeking:
            fits = self.wishing.fits(dict(self.state.wishes), self.state.operation)
            self._seeking = self.state.seeking = True
            self._say("A plan is sought for the wished face ...")
            asynchronous.create_task(self._seek(self.session.side, fits))

    def settle(self, *_):
        """The slider is let go."""
        self.session.draft.settle()

    @answered
    def save(self) -> None:
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
    def look(self, view: str) -> None:
        self.view.look(view)
        self._draw()

    # What the page does.

    def _begin(self, **_):
        self._images = next(part for part in self.server.protocol.getLinkProtocols() if hasattr(part, "push_render"))
        self._follow()

    def _draw(self) -> None:
        """Render and send the picture."""
        self.remote.update()
        asynchronous.create_task(self._send())

    async def _send(self) -> None:
        """Send the picture as soon as it is encoded; the view itself would look for it after half a second."""
        name = self.state[f"{self.remote.ref_name}Id"]
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
        self.state.labels = {name: label(name, segment) for name in AMOUNTS}
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
                    self._say(fitted(fit))
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
        self.remote.update()  # the picture is encoded while the words are made
        with self.state:
            self.state.about = self.state.about | {
                side: about(forecast, deep, self.session.jaws, self.calibration.level)
            }
            self.state.rows = self.state.rows | {side: rows(forecast, self.face, self.calibration)}
        await self._send()

    def _behind(self, side: str) -> bool:
        """Whether a side shows another plan than stands in the session, or a first look at it."""
        plan, shown = self.session.drafts[side].plan, self._shown.get(side)
        if self._refused.get(side) is plan:
            return False
        return shown is None or shown.plan is not plan or shown.least is None


def _number(text: object) -> float:
    try:
        return float(text)
    except (TypeError, ValueError):
        raise ValueError(f"{str(text)[:40]!r} is no number") from None
