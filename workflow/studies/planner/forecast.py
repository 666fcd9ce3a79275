"""The face that a plan leads to, plan after plan: everything that belongs to the patient is loaded once."""

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pinnochio.json_text import read_stored_json
from pinnochio.mechanics.held_lips import SEALED, held_lips
from pinnochio.mechanics.lift import Lift
from pinnochio.mechanics.settings import FemSettings
from pinnochio.mechanics.solvers.inversion_repair import Repair
from pinnochio.mechanics.solvers.linear_algebra import Workers
from pinnochio.methods.pinnochio.patient import tensors
from pinnochio.methods.pinnochio.predictor import Finishing, PatientGraphNetwork, load_network, load_sources
from pinnochio.methods.sources import PatientSources
from pinnochio.model.patient import PatientModel
from pinnochio.model.regions import regions
from pinnochio.patients.certificate import PARTS, astray, in_distribution, of_import
from pinnochio.patients.in_distribution import Ranges, beyond, out_of_range, widening
from pinnochio.patients.model_archive import RANGES, Archive, calibration_file, network_file
from pinnochio.plans.plan import Plan, RigidMotion
from pinnochio.statistics.intervals import Calibration, Interval, interval, repaired_interval, widened
from studies.planner.prepared import Prepared


@dataclass(frozen=True)
class Forecast:
    """What is predicted of a plan.

    interval: displacement of the nodes and half-widths of the skin; skin (s, 3) mm: points of the moved skin; mean,
    most: movement of the judged face, mm; least: smallest volume ratio of an element, None of a first look; repaired,
    damping: most elements that the inversion repair solved again, and its smallest factor on a whole field, 1 for none;
    off_bone: how far tissue has come from its bone or gone into it, at most, mm, 0 of a first look;
    crossed, apart: how far lips would cross, and stay apart that were closed before surgery, mm; beyond: how far
    patient or plan lies beyond the training, in widths of its range; out_of_distribution: what of patient and plan is
    (segments, muscle, anatomy, plan), out_of_range: so far that nothing was measured; seconds: since the beginning.
    """

    plan: Plan
    interval: Interval
    skin: np.ndarray
    mean: float
    most: float
    least: float | None
    repaired: int
    damping: float
    off_bone: float
    crossed: float
    apart: float
    beyond: float
    out_of_distribution: tuple[str, ...]
    out_of_range: bool
    seconds: float


class Forecaster:
    """The networks of every fold of an archive on one patient, as `snakemake predict` uses them; as many fields are
    corrected side by side as there are `threads`, the further ones by the factors of the first: the same within 0.001
    mm [X], and each again in half the time."""

    def __init__(self, prepared: Prepared, device: str, threads: int = 1):
        self.patient, self._fem = PatientModel.read(prepared.model), FemSettings(**prepared.fem)
        self._archive, folder = Archive.read(prepared.archive), Path(prepared.archive)
        self.calibration = Calibration.read(folder / calibration_file(prepared.method))
        self._ranges = Ranges.read(folder / RANGES)
        self._quality = read_stored_json(prepared.quality)
        self.imported = of_import(self._quality)
        self._region = regions(self.patient)
        self._judged = self.patient.judged_points
        files = [folder / network_file(prepared.method, fold) for fold in self._archive.folds]
        networks, settings = zip(*(load_network(file, device) for file in files), strict=True)
        lift = Lift.read(prepared.lift) if prepared.lift else None
        shared = tensors(self.patient, self._fem, settings[0], device, lift)  # the folds' networks have one form
        learned = map(load_sources, files)
        self._sources = [each and PatientSources(each, self.patient) for each in learned]
        self._networks = [PatientGraphNetwork(network, shared) for network in networks]
        self._finishing = [Finishing(self.patient, self._fem, prepared.corrections) for _ in range(threads)]
        self._correcting = Workers(threads)
        self._predicting = self._correcting if device == "cpu" else Workers(1)  # a GPU records one at a time
        little = RigidMotion(translation=np.array([0.0, -1, 0]))
        self(Plan(prepared.case, {self.patient.segments[0]: little}))  # so that no plan waits for code to be compiled

    def steps(self, plan: Plan) -> Iterator[Forecast | None]:
        """A first look at a plan, from the networks' raw fields; None after fields that are corrected; the forecast.

        So whoever sees the first look need not wait for the rest, and can leave it when there is another plan.
        FloatingPointError if a network gives no number.
        """
        began = time.perf_counter()
        fields = self._predicting.each(PatientGraphNetwork.__call__, [(network, plan) for network in self._networks])
        sources = [None if plan.still else each for each in self._sources]
        pairs = list(zip(fields, sources, strict=True))
        raw = [self._finishing[0].first_look(*pair) for pair in pairs]
        yield self._forecast(plan, interval(self.patient, raw, self.calibration, self._region), None, began)
        finished = []
        for first in range(0, len(pairs), len(self._finishing)):
            some = zip(self._finishing, pairs[first:], strict=False)
            finished += self._correcting.each(Finishing.__call__, [(each, *pair, first > 0) for each, pair in some])
            yield None
        result, repair = repaired_interval(
            self.patient, [each.displacement for each in finished], self.calibration, self._fem, self._region
        )
        repairs = [repair, *(each.repair for each in finished)]
        yield self._forecast(plan, result, repair.least, began, repairs)

    def __call__(self, plan: Plan) -> Forecast:
        """The forecast of a plan."""
        *_, forecast = self.steps(plan)
        return forecast

    def _forecast(
        self, plan: Plan, result: Interval, least: float | None, began: float, repairs: Sequence[Repair] = ()
    ) -> Forecast:
        compared = in_distribution(self.patient, plan, self._quality, self._ranges)
        result = widened(result, widening(compared))
        lips = held_lips(self.patient, result.displacement)
        skin = self.patient.moved_skin(lips.displacement)
        moved = np.linalg.norm(skin - self.patient.skin_points, axis=1)[self._judged]
        away = 0.0 if least is None else astray(self.patient, plan, result.displacement)
        return Forecast(
            plan=plan,
            interval=result,
            skin=skin,
            mean=float(moved.mean()),
            most=float(moved.max()),
            least=least,
            repaired=max((repair.elements for repair in repairs), default=0),
            damping=min((repair.damping for repair in repairs), default=1.0),
            off_bone=away,
            crossed=lips.crossed,
            apart=lips.left if lips.before <= SEALED else 0.0,
            beyond=beyond(compared),
            out_of_distribution=tuple(part for part in PARTS if not compared[part]["within"]),
            out_of_range=out_of_range(compared),
            seconds=time.perf_counter() - began,
        )
