"""Soft-to-hard tissue ratios: each region of the face follows its jaw by a fixed share, as cephalometry has it."""

from collections.abc import Mapping

import numpy as np
from scipy.spatial import cKDTree

from pinnochio.methods.protocol import Planned, predict_skin
from pinnochio.model.landmarks import face_landmarks
from pinnochio.model.patient import PatientModel
from pinnochio.model.predictions import Prediction
from pinnochio.model.regions import NAMES, NOT_JUDGED, RIM, regions
from pinnochio.plans.plan import Plan
from pinnochio.plans.roles import displacement_at

# Region: jaw that it follows and its share. Nose [S: PMC6173856] 0.17, [R] 0.2-0.35; lips [S] 0.21 and 0.66,
# [R] 0.4-0.7 and 0.6-0.8; chin [R] 0.9-1.0.
RATIOS = {"nose": ("upper", 0.25), "upper_lip": ("upper", 0.5), "lower_lip": ("lower", 0.7), "chin": ("chin", 0.95)}
CHEEK = 0.5  # of the lower jaw below the mouth, of the upper above it, falling to none at the rim of the orbit [I]
BLEND = 6.0  # mm over which neighbouring regions run into each other [I]
JAWS = ("upper", "lower", "chin")


class RatioPredictor:
    """As :class:`pinnochio.methods.protocol.Predictor`, without settings."""

    def __init__(self, settings: Mapping, trained: str | None, device: str, threads: int):
        self._threads = threads

    def __call__(self, planned: Planned) -> Prediction:
        """The skin alone; InputError where the face cannot be read."""
        return predict_skin(RatioRule, planned, self._threads)


class RatioRule:
    """The shares of one patient's skin points, which serve every plan."""

    def __init__(self, model: PatientModel):
        """InputError where the face cannot be read."""
        codes, skin = regions(model), model.skin_points
        marks = face_landmarks(model)
        rim = (1 - RIM) * marks.subnasale[2] + RIM * marks.sellion[2]
        shares = np.zeros((len(skin), len(JAWS)))
        for region, (jaw, share) in RATIOS.items():
            shares[codes == NAMES.index(region), JAWS.index(jaw)] = share
        cheek = np.isin(codes, [NAMES.index(name) for name in ("cheek_right", "cheek_left")])
        height = skin[cheek, 2]
        fading = np.clip((rim - height) / (rim - marks.subnasale[2]), 0, 1)
        upper = height > marks.stomion[2]
        shares[cheek, 0], shares[cheek, 1] = CHEEK * upper * fading, CHEEK * ~upper
        judged = np.flatnonzero(codes != NOT_JUDGED)
        near = cKDTree(skin[judged]).query_ball_point(skin, BLEND)
        blended = [shares[judged[points]].mean(axis=0) if len(points) else np.zeros(len(JAWS)) for points in near]
        self._skin, self._shares = skin, np.array(blended)

    def __call__(self, plan: Plan) -> np.ndarray:
        """Displacement (s, 3) mm of the skin points."""
        moved = np.zeros_like(self._skin)
        for jaw, share in zip(JAWS, self._shares.T, strict=True):
            moved += share[:, None] * displacement_at(plan, jaw, self._skin)
        return moved
