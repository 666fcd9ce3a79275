"""Whether a new patient and plan are in the distribution that the models were trained on, and by which numbers.

Every quantity is compared with its range over the training patients; what counts is how far the farthest one lies
outside, as a share of its range's width. Some of the quantities of a perfectly usual patient lie outside too. How far
is what the training patients themselves show: each is compared with all others in the same way, and the threshold is
what 95 of 100 stay below. So some 5 of 100 patients of the same kind are called out-of-distribution, however many
quantities are looked at (the conformal way, each patient left out in turn [R: Vovk, Gammerman, Shafer 2005]).
"""

import json
import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from pinnochio.files import replacing
from pinnochio.model.patient import PatientModel
from pinnochio.plans.plan import Plan

LEVEL = 0.95
# Least width of a range: in the quantity's own unit (mm, degrees, cm2, cm3), and as a share of its middle. Less is a
# matter of voxels [I].
LEAST, LEAST_SHARE = 1.0, 0.04
BESIDE_CONTACT = "released"  # contact with bone that an osteotomy takes away


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
        names = [name for name in patients[0] if all(np.isfinite(own.get(name, np.nan)) for own in patients)]
        values = np.array([[own[name] for name in names] for own in patients])
        count = len(values)
        scores = sorted(
            _excess(own, *_range(np.delete(values, place, axis=0), from_rest)).max(initial=0.0)
            for place, own in enumerate(values)
        )
        rank = min(count, math.ceil(LEVEL * (count + 1)))
        low, high = (dict(zip(names, end.tolist(), strict=True)) for end in _range(values, from_rest))
        return cls(low, high, float(scores[rank - 1]), 1 - rank / (count + 1), count)

    def compare(self, values: Mapping[str, float]) -> dict:
        """How a patient's values compare, as JSON holds it.

        within: whether no excess is above the threshold and every quantity can be compared; outside: the quantities
        outside their range, the farthest first; incomparable: those that the patient or the training lacks.
        """
        rows, excess = {}, {}
        for name in [*self.low, *(name for name in values if name not in self.low)]:
            value, low, high = values.get(name, np.nan), self.low.get(name), self.high.get(name)
            known = bool(np.isfinite(value))
            if known and low is not None:
                excess[name] = float(_excess(np.array(value), np.array(low), np.array(high)))
            rows[name] = {"value": float(value) if known else None, "low": low, "high": high}
            rows[name]["excess"] = excess.get(name)
        return {
            "within": len(excess) == len(rows) and max(excess.values(), default=0.0) <= self.threshold,
            "outside": sorted((name for name in excess if excess[name] > 0), key=lambda name: -excess[name]),
            "incomparable": [name for name in rows if name not in excess],
            "threshold": self.threshold,
            "false_alarm": self.false_alarm,
            "patients": self.patients,
            "quantities": rows,
        }


@dataclass(frozen=True)
class Ranges:
    """The norms of anatomy and plans of the training, and where the muscle layers of its patients come from."""

    anatomy: Norm
    plan: Norm
    muscle: Sequence[str]

    def write(self, path: str | os.PathLike) -> None:
        """Write as JSON."""
        with replacing(path) as temporary:
            temporary.write_text(json.dumps(asdict(self), indent=1) + "\n", encoding="utf-8")

    @classmethod
    def read(cls, path: str | os.PathLike) -> "Ranges":
        """Read what :meth:`write` wrote."""
        ranges = json.loads(Path(path).read_text(encoding="utf-8"))
        return cls(Norm(**ranges["anatomy"]), Norm(**ranges["plan"]), ranges["muscle"])


def _range(values: np.ndarray, from_rest: bool) -> tuple[np.ndarray, np.ndarray]:
    """Lowest and highest (q,) of values (p, q)."""
    low, high = values.min(axis=0), values.max(axis=0)
    return (np.minimum(low, 0), np.maximum(high, 0)) if from_rest else (low, high)


def _excess(values, low, high) -> np.ndarray:
    """How far each value lies outside its range, as a share of the range's width."""
    width = np.maximum(high - low, np.maximum(LEAST, LEAST_SHARE * np.abs(low + high) / 2))
    return np.maximum(np.maximum(values - high, low - values), 0) / width


def anatomy_quantities(patient: PatientModel, quality: Mapping) -> dict[str, float]:
    """Extents (mm), volumes (cm3), thickness of the soft tissue over each bone (mm) and its contact with it (cm2).

    quality: the patient's quality report (metrics.quality).
    """
    extent = np.ptp(patient.points, axis=0)
    quantities = dict(zip(("width_mm", "depth_mm", "height_mm"), extent.tolist(), strict=True))
    quantities |= {f"volume_{name}_cm3": float(value) for name, value in quality["volume_cm3"].items()}
    for bone, values in quality["thickness_mm"].items():
        quantities[f"thickness_{bone}_mm"] = float(values["mean"]) if values else np.nan
    for bone, areas in quality["contact_cm2"].items():
        quantities[f"contact_{bone}_cm2"] = sum(area for kind, area in areas.items() if kind != BESIDE_CONTACT)
    return quantities


def plan_quantities(patient: PatientModel, plan: Plan) -> dict[str, float]:
    """Where the middle of each segment goes (sideways either way, forward, up; mm), and how far it turns (degrees).

    Sideways either way, because networks are trained on mirror images too.
    """
    quantities = {}
    for index, name in enumerate(patient.segments):
        motion = plan.motion(name)
        middle = patient.bone_points[patient.bone_segment == index].mean(axis=0)
        left, back, up = motion.displacement(middle[None])[0].tolist()
        turned = math.degrees(Rotation.from_matrix(motion.rotation).magnitude())
        quantities |= {f"sideways_{name}_mm": abs(left), f"forward_{name}_mm": -back, f"up_{name}_mm": up}
        quantities[f"rotation_{name}_deg"] = turned
    return quantities
