"""Half-widths of a skin prediction's interval per region and measure, by held-out errors, and how often they cover.

A score is the distance from a predicted skin point to the post-operative skin, of a patient whom the predicting model
never saw. The exchangeable unit is the patient, whose points are anything but independent. :func:`half_width` is the
quantile of hierarchical conformal prediction (Lee, Barber and Willett 2023, arXiv:2306.06342 [S]): the pooled CDF of
Dunn, Wasserman and Ramdas (JASA 2023 [S]) with a finite-sample correction.

What is guaranteed, for one model and patients exchangeable with those it was calibrated on: a point drawn at random
from a region of a new patient lies no farther than the half-width from the outcome with probability `level` or more.
That is an average over cohorts, patients and points: it holds neither for each patient nor for each point, nor for
all points at once. And it is about what a scan shows, its noise and registration included. Of a measure a patient has
one error: the half-width is that of split conformal prediction.

Held-out errors of cross-validation come from as many models as folds. In the worst case of the theory such intervals
cover only 1 - 2 (1 - level) or a little less (cross-conformal prediction: Vovk 2015 [R]; CV+: Barber et al. 2021 [S]);
in practice they come out near the level. Hence :func:`coverage`, which tests each fold by the errors of the others.
"""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd
from scipy.spatial import cKDTree

from pinnochio.geometry.closest_points import closest_points
from pinnochio.metrics.judged import Judged
from pinnochio.model.carried import NEAR, carried_landmarks
from pinnochio.model.measures import MEASURES, measure
from pinnochio.model.patient import PatientModel
from pinnochio.model.postop import PostopSkin
from pinnochio.model.regions import NAMES
from pinnochio.model.truth import TrueMotion
from pinnochio.seeds import derive_seed
from pinnochio.statistics.wilcoxon import bootstrap_interval

FACE, ALL = "face", "measures"  # all regions, and all measures, together, each by its own half-width
REGIONS = dict.fromkeys(NAMES, "mm")
UNSEEN = ("interlabial_gap", "alar_width", "midline", "chin_asymmetry")  # along the skin, or at the lips' edges


@dataclass(frozen=True)
class HeldOut:
    """One patient held out of a fold: error (k,) mm and region (k,) of the skin points that could be judged, or error
    (k,) of measures, mm or degrees, and in place of a region which of MEASURES each is."""

    case: str
    fold: str
    error: np.ndarray
    region: np.ndarray

    def of(self, region: int) -> np.ndarray:
        """Errors of one region."""
        return self.error[self.region == region]


def held_out(case: str, fold: str, patient: PatientModel, judged: Judged, moved, points, faces) -> HeldOut:
    """Errors of the predicted skin, moved (s, 3) mm, against the registered post-operative skin points, faces.

    judged: the samples of the skin, which are those of the accuracy.
    """
    samples = judged.before(patient).carried(moved)
    known = judged.skin_region >= 0
    return HeldOut(case, fold, closest_points(samples[known], points, faces).distance, judged.skin_region[known])


def measures_held_out(
    case: str, fold: str, patient: PatientModel, displacement, scan: PostopSkin, truth: TrueMotion | None
) -> HeldOut:
    """Errors of the MEASURES that can be read of a field (n, 3) mm.

    The outcome's landmarks lie where the truth takes them. Without one, of a cohort of a clinic, they lie as far from
    the predicted ones as, in the mean, the scan from the skin within NEAR of them; that leaves UNSEEN out.
    """
    marks = carried_landmarks(patient)
    after = marks.moved(displacement)
    if truth:
        outcome = marks.moved(truth.nodes)
    else:
        skin = np.unique(patient.skin_faces)
        moved = patient.moved_skin(displacement)[skin]
        closest = closest_points(moved, scan.points, scan.faces)
        way = np.where(closest.border[:, None], np.nan, closest.points - moved)
        near = cKDTree(patient.skin_points[skin]).query_ball_point(np.nan_to_num(marks.positions), NEAR)
        outcome = after + np.array([np.ma.masked_invalid(way[place]).mean(axis=0).filled(np.nan) for place in near])
    errors = dict(zip(MEASURES, np.abs(measure(outcome) - measure(after)), strict=True))
    errors |= {} if truth else dict.fromkeys(UNSEEN, np.nan)
    error = np.array(list(errors.values()))
    return HeldOut(case, fold, error[np.isfinite(error)], np.flatnonzero(np.isfinite(error)))


def half_width(errors: Sequence[np.ndarray], level: float) -> float:
    """Conformal half-width (mm) of patients' errors, one array each; inf where too few patients have any.

    The `level` quantile of all errors, where each of K patients weighs 1 / (K + 1) in all and the new one, of whom
    nothing is known, as much at infinity. Finite if K >= level / (1 - level): 9 patients for 90 percent. The price of
    that safety: where patients are alike, level (K + 1) / K is covered, 92.3 percent for 90 of 39 patients.
    """
    errors = [values for values in errors if len(values)]
    if not errors:
        return np.inf
    values = np.concatenate(errors)
    weights = np.repeat([1 / len(part) for part in errors], [len(part) for part in errors]) / (len(errors) + 1)
    order = np.argsort(values)
    reached = np.cumsum(weights[order]) >= level - 1e-9
    return float(values[order][reached.argmax()]) if reached.any() else np.inf


def half_widths(patients: Sequence[HeldOut], level: float, names: Collection[str] = NAMES) -> np.ndarray:
    """Half-width (mm, or as the errors) of every region or measure of `names`."""
    return np.array([half_width([patient.of(code) for patient in patients], level) for code in range(len(names))])


def coverage(
    patients: Sequence[HeldOut], level: float, seed: int = 0, units: Mapping[str, str] = REGIONS, whole: str = FACE
) -> pd.DataFrame:
    """One row per region (or measure, by its unit) that anybody has, and the whole: how much lies within half-widths
    that other folds came to.

    Shares are taken per patient and patients weigh equally; empty where the other folds have too few patients. The
    half_width is that of all patients, which a new one gets; low and high are the extremes over folds. The columns but
    `method` are those of coverage_table.COVERAGE.
    """
    folds = sorted({patient.fold for patient in patients})
    widths = {fold: half_widths([other for other in patients if other.fold != fold], level, units) for fold in folds}
    every, by_fold = half_widths(patients, level, units), np.array(list(widths.values()))
    rows = []
    for code, name in enumerate([*units, whole]):
        together, unit = name == whole, units.get(name, ", ".join(dict.fromkeys(units.values())))
        with_region = [patient for patient in patients if together and len(patient.error) or len(patient.of(code))]
        if not with_region:
            continue
        shares = np.array([_share(patient, widths[patient.fold], code) for patient in with_region])
        errors = [patient.error if together else patient.of(code) for patient in with_region]
        measured = shares[np.isfinite(shares)]
        low, high = bootstrap_interval(measured, derive_seed(seed, "coverage", name))
        rows.append(
            {
                "region": name,
                "unit": unit,
                "level": 100 * level,
                "n": len(with_region),
                "points": np.mean([len(values) for values in errors]),
                "error_mean": np.mean([values.mean() for values in errors]) if "," not in unit else np.nan,
                "coverage_mean": measured.mean() if len(measured) else np.nan,
                "coverage_sd": measured.std(ddof=1) if len(measured) > 1 else np.nan,
                "coverage_low": low,
                "coverage_high": high,
                "half_width": np.nan if together else _finite(every[code]),
                "half_width_low": np.nan if together else _finite(by_fold[:, code].min()),
                "half_width_high": np.nan if together else _finite(by_fold[:, code].max()),
            }
        )
    return pd.DataFrame(rows)


def _share(patient: HeldOut, widths: np.ndarray, code: int) -> float:
    """Percentage of the points of a region, or of all, within their half-widths; NaN where one is infinite."""
    chosen = np.ones(len(patient.error), bool) if code == len(widths) else patient.region == code
    bound = widths[patient.region[chosen]]
    return 100 * float(np.mean(patient.error[chosen] <= bound)) if np.isfinite(bound).all() else np.nan


def _finite(value: float) -> float:
    return float(value) if np.isfinite(value) else np.nan
