"""Whether a new patient and plan are in the distribution that the models were trained on, and by which numbers.

Every quantity is compared with its range over the training patients; what counts is how far the farthest one lies
outside, as a share of its range's width. Some of the quantities of a perfectly usual patient lie outside too. How far
is what the training patients themselves show: each is compared with all others in the same way, and the threshold is
what 95 of 100 stay below. So some 5 of 100 patients of the same kind are called out-of-distribution, however many
quantities are looked at (the conformal way, each patient left out in turn [R: Vovk, Gammerman, Shafer 2005]).
"""

import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass

import numpy as np

from pinnochio.json_text import read_stored_json, write_json
from pinnochio.model.bones import motion_of_places
from pinnochio.model.labels import TISSUES
from pinnochio.model.patient import PatientModel
from pinnochio.plans.plan import Plan
from pinnochio.plans.roles import UNCUT, of_role

LEVEL = 0.95
# Least width of a range: in the quantity's own unit (mm, degrees, cm2, cm3), and as a share of its middle. Less is a
# matter of voxels [I].
LEAST, LEAST_SHARE = 1.0, 0.04
# Widths beyond what is usual up to which networks were nearer than finite elements, and `widening` held [X:
# docs/lab/certificate.md].
MEASURED = 0.5
BESIDE_CONTACT = "released"  # contact with bone that an osteotomy takes away
TURNED = {"maxilla": ("maxilla",), "mandible": ("distal", UNCUT), "rami": ("proximal",), "chin": ("chin",)}


@dataclass(frozen=True)
class Norm:
    """What is usual of one group of quantities: low and high by their names.

    threshold: excess that a patient of the same kind has with probability false_alarm; patients: how many were seen.
    """

    low: Mapping[str, float]
    high: Mapping[str, float]
    threshold: float
    false_alarm: float
    patients: int

    @classmethod
    def of(cls, patients: Sequence[Mapping[str, float]], from_rest: bool = False) -> "Norm":
        """The norm of the quantities that all of at least two patients have.

        from_rest: the ranges begin at zero where they do not hold it, because half a movement is usual too.
        """
        names = [name for name in patients[0] if all(np.isfinite(patient.get(name, np.nan)) for patient in patients)]
        values = np.array([[patient[name] for name in names] for patient in patients])
        count = len(values)
        scores = sorted(
            _excess(patient, *_range(np.delete(values, place, axis=0), from_rest)).max(initial=0.0)
            for place, patient in enumerate(values)
        )
        rank = min(count, math.ceil(LEVEL * (count + 1)))
        low, high = (dict(zip(names, end.tolist(), strict=True)) for end in _range(values, from_rest))
        return cls(low, high, float(scores[rank - 1]), 1 - rank / (count + 1), count)

    def compare(self, values: Mapping[str, float]) -> dict:
        """How a patient's values compare, as JSON holds it.

        within: whether no excess is above the threshold and every quantity can be compared; farthest: the largest
        excess; outside: the quantities outside their range, the farthest first; incomparable: those that the patient or
        the training alone lacks.
        """
        rows, excess = {}, {}
        further = [name for name, value in values.items() if name not in self.low and np.isfinite(value)]
        for name in [*self.low, *further]:
            value, low, high = values.get(name, np.nan), self.low.get(name), self.high.get(name)
            known = bool(np.isfinite(value))
            if known and low is not None:
                excess[name] = float(_excess(np.array(value), np.array(low), np.array(high)))
            rows[name] = {"value": float(value) if known else None, "low": low, "high": high}
            rows[name]["excess"] = excess.get(name)
        return {
            "within": len(excess) == len(rows) and max(excess.values(), default=0.0) <= self.threshold,
            "farthest": max(excess.values(), default=0.0),
            "outside": sorted((name for name in excess if excess[name] > 0), key=lambda name: -excess[name]),
            "incomparable": [name for name in rows if name not in excess],
            "threshold": self.threshold,
            "false_alarm": self.false_alarm,
            "patients": self.patients,
            "quantities": rows,
        }


@dataclass(frozen=True)
class Ranges:
    """The norms of anatomy and plans of the training, where the muscle layers of its patients come from, and the bone
    segments that its patients have."""

    anatomy: Norm
    plan: Norm
    muscle: Sequence[str]
    segments: Sequence[str]

    def write(self, path: str | os.PathLike) -> None:
        """Write as JSON."""
        write_json(path, asdict(self))

    @classmethod
    def read(cls, path: str | os.PathLike) -> "Ranges":
        """Read what :meth:`write` wrote."""
        ranges = read_stored_json(path)
        return cls(ranges["anatomy"].of(Norm), ranges["plan"].of(Norm), ranges["muscle"], ranges["segments"])


def beyond(compared: Mapping) -> float:
    """How far anatomy or plan lies beyond what is usual of the training, in widths of its range.

    compared: anatomy and plan as :meth:`Norm.compare` gives them.
    """
    return max(max(0.0, compared[name]["farthest"] - compared[name]["threshold"]) for name in ("anatomy", "plan"))


def out_of_range(compared: Mapping) -> bool:
    """Whether nobody knows what networks do on the patient: a segment, a muscle layer or a quantity without counterpart
    in the training, or anatomy or plan farther beyond it than was measured."""
    unknown = any(compared[name]["incomparable"] for name in ("anatomy", "plan"))
    unknown |= not (compared["segments"]["within"] and compared["muscle"]["within"])
    return unknown or beyond(compared) > MEASURED


def widening(compared: Mapping) -> float:
    """Factor on the half-widths of the interval: 1 within the training, and as many times more as anatomy or plan lies
    widths of the training's range beyond it.

    Measured up to half a width [X]; farther out an error is expected to grow no faster than the movement does [I].
    """
    return 1.0 + beyond(compared)


def _range(values: np.ndarray, from_rest: bool) -> tuple[np.ndarray, np.ndarray]:
    """Lowest and highest (q,) of values (p, q)."""
    low, high = values.min(axis=0), values.max(axis=0)
    return (np.minimum(low, 0), np.maximum(high, 0)) if from_rest else (low, high)


def _excess(values, low, high) -> np.ndarray:
    """How far each value lies outside its range, as a share of the range's width."""
    width = np.maximum(high - low, np.maximum(LEAST, LEAST_SHARE * np.abs(low + high) / 2))
    return np.maximum(np.maximum(values - high, low - values), 0) / width


def anatomy_quantities(patient: PatientModel, quality: Mapping) -> dict[str, float]:
    """Extents (mm), volumes (cm3), thickness of the soft tissue over skull and lower jaw (mm) and its contact (cm2).

    quality: the patient's quality report (metrics.quality). The skull is cranium and maxilla, the lower jaw all of its
    pieces, so that the same head has the same numbers however it is cut; the thickness is the mean of the bones',
    weighted by their contact. NaN where a bone has none.
    """
    extent = np.ptp(patient.points, axis=0)
    quantities = dict(zip(("width_mm", "depth_mm", "height_mm"), extent.tolist(), strict=True))
    volume, thickness = quality["volume_cm3"], quality["thickness_mm"]
    quantities |= {f"volume_{name}_cm3": float(volume[name]) for name in TISSUES}
    touched = {
        bone: sum(area for kind, area in areas.items() if kind != BESIDE_CONTACT)
        for bone, areas in quality["contact_cm2"].items()
    }
    skull = ["cranium", *of_role(patient.segments, "maxilla")]
    for name, bones in (("skull", skull), ("lower_jaw", [bone for bone in patient.segments if bone not in skull])):
        area = {bone: touched[bone] for bone in bones if thickness[bone]}
        total = sum(area.values())
        mean = sum(thickness[bone]["mean"] * weight for bone, weight in area.items()) / total if total else np.nan
        quantities |= {
            f"volume_{name}_cm3": float(sum(volume[bone] for bone in bones)) if bones else np.nan,
            f"thickness_{name}_mm": float(mean),
            f"contact_{name}_cm2": float(sum(touched[bone] for bone in bones)) if bones else np.nan,
        }
    return quantities


def plan_quantities(patient: PatientModel, plan: Plan) -> dict[str, float]:
    """Where the places of the skeleton go (sideways either way, forward, up; mm), and how far the most turned segment
    of each role turns (degrees): the same quantities however a case is cut, zero of what is not.

    Sideways either way, because networks are trained on mirror images too.
    """
    quantities = {}
    for name, (left, back, up) in motion_of_places(patient, plan).items():
        quantities |= {f"sideways_{name}_mm": abs(left), f"forward_{name}_mm": -back, f"up_{name}_mm": up}
    for name, roles in TURNED.items():
        angles = [plan.motion(ramus).angle for ramus in of_role(patient.segments, *roles)]
        quantities[f"rotation_{name}_deg"] = max(angles, default=0.0)
    return {name: float(value) for name, value in quantities.items()}
