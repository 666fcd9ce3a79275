"""What a clinic knows of a patient beside plan and images: sex, age, body mass, months to the scan, sutures."""

import os
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from pinnochio.json_text import read_stored_json, write_json
from pinnochio.plans.sampling import truncated
from pinnochio.virtual.ground_truth import CLINIC, REALITIES
from pinnochio.virtual.published_thickness import PUBLISHED

AGE = (25.0, 7.0, 18.0, 55.0)  # mean, SD, bounds in years of patients with orthognathic surgery [R]
BMI = (23.5, 3.5, 17.0, 38.0)  # kg/m2 [R]
WITH_THICKNESS = 0.5  # correlation of the body mass with the thickness of the cheeks [I]
EARLIEST = 3.0  # months
VY, CINCH = 0.5, 0.6  # shares of patients with V-Y closure and with an alar cinch suture [I]
CHEEKS = ("cheek", "masseter")
# Name: (distribution, source, what it decides) as the data card shows them.
MEANING = {
    "sex": ("that of the head", "", "nothing by itself: lips and chin are thicker in men"),
    "age": ("{:g} ± {:g} years, {:g} to {:g}".format(*AGE), "[R]", "softness of superficial tissue, and so posture"),
    "bmi": (
        "{:g} ± {:g} kg/m2, {:g} to {:g}; correlation with thick cheeks 0.5".format(*BMI),
        "[R], correlation [I]",
        "softness of superficial tissue, and so posture; weight lost",
    ),
    "months": ("6 ± 1.5 (clinic), 12 ± 2 (same modality), 3 at least", "[I]", "swelling"),
    "closure": ("V-Y in half of the patients, else simple", "[I]", "upper lip"),
    "cinch": ("in 60 % of the patients", "[I]", "width of the nose"),
}


@dataclass(frozen=True)
class Covariates:
    """sex female | male; age in years; bmi in kg/m2; months from surgery to the scan; closure of the upper vestibule
    vy | simple; cinch: an alar cinch suture."""

    sex: str
    age: float
    bmi: float
    months: float
    closure: str
    cinch: bool

    @property
    def mass(self) -> float:
        """Body mass in standard deviations from its mean."""
        return (self.bmi - BMI[0]) / BMI[1]

    def write(self, path: str | os.PathLike) -> None:
        """Write as JSON."""
        write_json(path, asdict(self))

    @classmethod
    def read(cls, path: str | os.PathLike) -> "Covariates":
        """Read what :meth:`write` wrote."""
        return read_stored_json(path).of(cls)


def thickness_scores(thickness: Mapping[str, float | None]) -> dict[str, float]:
    """Thickness (mm, None where no bone) by landmark in published standard deviations from the published mean."""
    return {
        name: 0.0 if thickness.get(name) is None else (thickness[name] - known.mean) / known.sd
        for name, known in PUBLISHED.items()
    }


def sample_covariates(anatomy: Mapping[str, Any], reality: str, rng: np.random.Generator) -> Covariates:
    """Draw the covariates of a patient with this anatomy (as `describe` gives it); nominal is scanned as the clinic."""
    months, spread = REALITIES.get(reality, REALITIES[CLINIC]).months
    scores = thickness_scores(anatomy["thickness"])
    age, scatter = truncated(rng, *AGE), rng.normal()
    fat = np.mean([scores[name] for name in CHEEKS])
    bmi = BMI[0] + BMI[1] * (WITH_THICKNESS * fat + np.sqrt(1 - WITH_THICKNESS**2) * scatter)
    return Covariates(
        sex=anatomy["sex"],
        age=round(age, 1),
        bmi=round(float(np.clip(bmi, *BMI[2:])), 1),
        months=round(truncated(rng, months, spread, EARLIEST, 2 * months), 1),
        closure="vy" if rng.random() < VY else "simple",
        cinch=bool(rng.random() < CINCH),
    )
