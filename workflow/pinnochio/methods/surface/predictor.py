"""Prediction by a trained surface network: the skin alone."""

from collections.abc import Mapping
from functools import partial

import numpy as np
import torch
from torch import nn

from pinnochio.geometry.scattered import nearest, spread
from pinnochio.methods.protocol import Planned
from pinnochio.methods.surface.architectures import build, run_network
from pinnochio.methods.surface.patient import SurfacePatient
from pinnochio.methods.surface.settings import SurfaceSettings
from pinnochio.model.patient import PatientModel
from pinnochio.model.predictions import Prediction
from pinnochio.networks.clouds import to_device
from pinnochio.plans.plan import Plan
from pinnochio.timing import timed
from pinnochio.training.checkpoint import read_network


class SurfacePredictor:
    """As :class:`pinnochio.methods.protocol.Predictor`; the settings lie in the trained file."""

    def __init__(self, settings: Mapping, trained: str, device: str, threads: int):
        self._network, self._settings = read_network(trained, SurfaceSettings, build, device)
        self._device, self._threads = device, threads

    def __call__(self, planned: Planned) -> Prediction:
        """The skin alone, warm."""

        def prepare():
            network = PatientSurfaceNetwork(self._network, self._settings, planned.patient, planned.case, self._device)
            return partial(network, planned.plan)

        skin, seconds, setup = timed(prepare, planned.warm)
        return Prediction(None, seconds, setup, self._threads, self._device, skin=skin)


class PatientSurfaceNetwork:
    """A trained surface network on one patient: its points are drawn once and serve every plan."""

    def __init__(self, network: nn.Module, settings: SurfaceSettings, model: PatientModel, case: str, device: str):
        self.network, self.settings, self.device = network.eval(), settings, device
        self.patient = SurfacePatient.build(model, settings, case, repeats=1)
        self._ways = None

    def __call__(self, plan: Plan) -> np.ndarray:
        """Displacement (s, 3) mm of the skin points, interpolated from the nearest face points.

        FloatingPointError if the network gives no number.
        """
        torch.manual_seed(0)  # DGCFP draws triangles
        draw = self.patient.draws[0]
        with torch.inference_mode():
            inputs = to_device(self.patient.inputs(draw, plan), self.device)
            stage = run_network(self.network, self.settings, inputs)[-1]
            rest, moved = (x.cpu().numpy().astype(float) for x in (stage.rest, stage.displacement))
        if not np.isfinite(moved).all():
            raise FloatingPointError(f"case {plan.case!r}: the predicted displacement is not finite")
        if self._ways is None:  # where points were is the same under every plan
            skin = (self.patient.model.skin_points - self.patient.centre) / self.patient.unit
            self._ways = nearest(skin, rest)
        return spread(moved, *self._ways) * self.patient.unit
