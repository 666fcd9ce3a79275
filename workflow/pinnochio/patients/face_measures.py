"""What a plan changes in the usual measures of a face: before, after, change and interval; and where landmarks go."""

import logging
import os
from dataclasses import asdict, dataclass
from functools import cached_property

import numpy as np
from scipy.spatial import cKDTree

from pinnochio.columns import Column, number, write_rows
from pinnochio.errors import InputError
from pinnochio.figures.cephalogram import Cephalogram
from pinnochio.model.bone_landmarks import BONE_MEASURES, bone_measures
from pinnochio.model.carried import CarriedLandmarks, carried_landmarks
from pinnochio.model.measures import LANDMARKS, MEASURES, measure
from pinnochio.model.patient import PatientModel
from pinnochio.plans.plan import Plan
from pinnochio.statistics.intervals import Calibration, Interval

# The landmarks whose displacement is shown, as surgeons write them.
SHOWN = {"pronasale": "Nasal tip", "subnasale": "Subnasale", "subspinale": "A'", "labrale_superius": "Upper lip",
         "labrale_inferius": "Lower lip", "sublabiale": "B'", "pogonion": "Pog'", "menton": "Me'"}  # fmt: skip
WAYS = {"forward": (0, -1, 0), "up": (0, 0, 1), "to the left": (1, 0, 0)}
TABLE = (
    Column("name", str, "", "landmark or measure"),
    Column("title", str, "", "as surgeons write it"),
    Column("unit", str, "", "mm or degree, of the numbers that follow"),
    Column("positive", str, "", "what a larger value means"),
    number("before", "of the row", "before surgery; empty of a displacement, and where it cannot be read", ".4f"),
    number("after", "of the row", "after the plan", ".4f"),
    number("change", "of the row", "after - before", ".4f"),
    number("half_width", "of the row", "of the interval about `after`; empty where there is none", ".4f"),
)


@dataclass(frozen=True)
class MeasureRow:
    """One line of TABLE; NaN where a number is not known."""

    name: str
    title: str
    unit: str
    positive: str
    before: float
    after: float
    change: float
    half_width: float


class FaceMeasures:
    """The landmarks of one patient, found once; :meth:`rows` serves every plan."""

    def __init__(self, patient: PatientModel):
        self._patient = patient
        self.landmarks: CarriedLandmarks = carried_landmarks(patient)
        self._before = measure(self.landmarks.positions)
        judged = patient.judged_points
        known = np.isfinite(self.landmarks.positions).all(axis=1)
        places = np.where(known[:, None], self.landmarks.positions, 0)
        self._nearest = judged[cKDTree(patient.skin_points[judged]).query(places)[1]]

    def tracing(self, plan: Plan, displacement: np.ndarray) -> str:
        """The lateral cephalogram under a plan and a field (n, 3) mm, as SVG."""
        return self._cephalogram.svg(plan, displacement)

    def bone_rows(self, plan: Plan) -> list[MeasureRow]:
        """What surgeons read off the bone's landmarks before and after a plan."""
        before, after = (bone_measures(self._cephalogram.bone.under(one)) for one in (Plan(plan.case, {}), plan))
        return [
            MeasureRow(name, *words, old, new, new - old, np.nan)
            for (name, words), old, new in zip(BONE_MEASURES.items(), before, after, strict=True)
        ]

    @cached_property
    def _cephalogram(self) -> Cephalogram:
        return Cephalogram(self._patient, self.landmarks)

    def rows(
        self, displacement: np.ndarray, interval: Interval | None = None, calibration: Calibration | None = None
    ) -> list[MeasureRow]:
        """The measures, then how far forward, up and to the left the SHOWN landmarks go, under a field (n, 3) mm.

        interval: the field's, by the calibration. A measure has its calibrated half-width, as many times wider as the
        skin's interval is than the calibrated one at most at a landmark that the measure reads [I]; a landmark has that
        of the skin there.
        """
        moved = self.landmarks.moved(displacement)
        widths, spread = np.full(len(LANDMARKS), np.nan), dict.fromkeys(MEASURES, np.nan)
        if interval is not None and calibration is not None:
            widths = interval.half_width[self._nearest]
            wider = np.nan_to_num(widths / calibration.by_region[interval.region[self._nearest]], nan=1.0)
            for name, width in calibration.measures.items():
                read = [LANDMARKS.index(point) for point in MEASURES[name].points]
                spread[name] = np.nan if width is None else width * wider[read].max()
        rows = [
            MeasureRow(name, one.title, one.unit, one.positive, before, now, now - before, spread[name] + 0 * now)
            for (name, one), before, now in zip(MEASURES.items(), self._before, measure(moved), strict=True)
        ]
        shift = moved - self.landmarks.positions
        for name, title in SHOWN.items():
            place = LANDMARKS.index(name)
            for way, axis in WAYS.items():
                change = float(shift[place] @ axis)
                key = f"{name}_{way.split()[-1]}"
                rows.append(MeasureRow(key, title, "mm", way, np.nan, np.nan, change, float(widths[place])))
        return rows


def read_face(patient: PatientModel) -> FaceMeasures | None:
    """The measures of a face; None where it cannot be read, which the log says."""
    try:
        return FaceMeasures(patient)
    except InputError as error:
        logging.warning("no measures: %s", error)
    return None


def unknown_rows() -> list[MeasureRow]:
    """The rows of a face that cannot be read."""
    unknown = dict.fromkeys(("before", "after", "change", "half_width"), np.nan)
    rows = [MeasureRow(name, one.title, one.unit, one.positive, **unknown) for name, one in MEASURES.items()]
    ways = [(name, title, way) for name, title in SHOWN.items() for way in WAYS]
    return rows + [MeasureRow(f"{name}_{way.split()[-1]}", title, "mm", way, **unknown) for name, title, way in ways]


def write_face(rows: list[MeasureRow], path: str | os.PathLike) -> None:
    """Write the rows as CSV."""
    write_rows([asdict(row) for row in rows], path, TABLE)


def written(value: float, digits: int, sign: str = "") -> str:
    """A number as pages show it; a dash where there is none, and no sign where it shows as zero."""
    if not np.isfinite(value):
        return "–"
    text = format(value, f"{sign}.{digits}f")
    return text.lstrip("+-") if not float(text) else text.replace("-", "−")


def in_numbers(rows: list[MeasureRow]) -> tuple[list[dict], list[dict], list[dict]]:
    """Measures, how far each landmark goes forward, up and left, and measures of bone, as pages write them; half: the
    half-width."""
    measures, moved, bone = [], {}, []
    for row in rows:
        half = {"half": written(row.half_width, 1)}
        if row.name in MEASURES or row.name in BONE_MEASURES:
            digits, unit = (int(row.name in BONE_MEASURES), "°") if row.unit == "degree" else (1, "mm")
            numbers = {"before": written(row.before, digits), "after": written(row.after, digits)}
            title = {"name": row.name, "title": f"{row.title}, {unit}"}
            table = measures if row.name in MEASURES else bone
            table.append(title | numbers | {"change": written(row.change, 1, "+")} | half)
        else:
            place = moved.setdefault(row.title, {"title": row.title} | half)
            place[row.positive.split()[-1]] = written(row.change, 1, "+")
    return measures, list(moved.values()), bone
