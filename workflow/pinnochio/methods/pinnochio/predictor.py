"""Prediction by a trained graph network, whose fields are repaired and corrected before they are returned."""

import logging
import os
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
import torch
from torch import nn

from pinnochio.mechanics.load_sources import AnsweringTissue
from pinnochio.mechanics.settings import FemSettings
from pinnochio.mechanics.solvers.newton_corrections import Finish
from pinnochio.methods.pinnochio.patient import PatientTensors, tensors
from pinnochio.methods.protocol import Planned
from pinnochio.methods.sources import PatientSources, SourceModel
from pinnochio.model.predictions import Prediction
from pinnochio.networks.building import build
from pinnochio.networks.settings import NetworkSettings
from pinnochio.networks.signals import InterfaceAndVolume, PlanSignal
from pinnochio.plans.plan import Plan
from pinnochio.timing import timed
from pinnochio.training.checkpoint import load_tensors, read_network


class GraphPredictor:
    """As :class:`pinnochio.methods.protocol.Predictor`; settings: fem and newton_corrections.

    No field is returned with an inverted element, and each after so many Newton corrections; both are timed with the
    network, warm.
    """

    def __init__(self, settings: Mapping, trained: str | os.PathLike, device: str, threads: int):
        self.network, self._settings = load_network(trained, device)
        self._learned = load_sources(trained)
        self._fem, self._corrections = FemSettings(**settings["fem"]), settings["newton_corrections"]
        self._device, self._threads = device, threads

    def __call__(self, planned: Planned) -> Prediction:
        """Displacement and boundary of every node, with what the inversion repair did."""
        finish = planned.once(Finish, planned.patient, self._fem, self._corrections)

        def prepare():
            network = planned.once(self._of_patient, planned)

            def predict():
                raw = network(planned.plan)
                return raw, *finish(*raw)

            return predict

        (raw, displacement, repair, corrections), seconds, setup = timed(prepare, planned.warm)
        logging.info("%s: %s", planned.case, repair)
        return Prediction(
            displacement,
            seconds,
            setup + (planned.lift.seconds if planned.lift else 0.0),
            self._threads,
            self._device,
            iterations=corrections,
            boundary=raw.boundary,
            raw=raw.displacement,
            forces=raw.forces,
            repaired=repair.elements,
            damping=repair.damping,
        )

    def _of_patient(self, planned: Planned) -> "PatientGraphNetwork":
        sources, model = None, planned.patient
        if self._learned:
            sources = PatientSources(self._learned, model, planned.once(AnsweringTissue, model, self._fem))
        patient = planned.once(tensors, model, self._fem, self._settings, self._device, planned.lift)
        return PatientGraphNetwork(self.network, patient, sources)


class RawField(NamedTuple):
    """What a network says of a plan: displacement (n, 3) mm of every node, and of the interface nodes as P_bnd gives
    it; forces (n, 3) mN: the load of the learned sources, which the displacement has answered to first order, or None.
    """

    displacement: np.ndarray
    boundary: np.ndarray
    forces: np.ndarray | None = None


class PatientGraphNetwork:
    """A trained network on one patient: what belongs to the patient is computed once and serves every plan.

    sources: those that were learned with it, if any. On a GPU the first plan records the kernels, and every later one
    replays them without the cost of their launches.
    """

    def __init__(self, network: nn.Module, patient: PatientTensors, sources: PatientSources | None = None):
        self.network, self.patient, self.sources, self._recorded = network, patient, sources, None
        with torch.inference_mode():
            self._rest = network.encode_rest(patient.anatomy)

    def __call__(self, plan: Plan) -> RawField:
        """The field, float64; exactly zero for a plan that moves nothing, whatever was learned.

        FloatingPointError if the network gives no number.
        """
        if plan.still:
            return RawField(*(np.zeros((len(self.patient.points), 3)) for _ in range(2)))
        with torch.inference_mode():
            output = self._run(self.patient.signal(plan))
            # A node of which no boundary network speaks has its own displacement.
            boundary = torch.where(output.known > 0, output.boundary, output.displacement)
            displacement, boundary = (x.cpu().numpy().astype(float) for x in (output.displacement, boundary))
        if not np.isfinite(displacement).all():
            raise FloatingPointError(f"case {plan.case!r}: the predicted displacement is not finite")
        if self.sources is None:
            return RawField(displacement, boundary)
        forces, answer = self.sources(plan)
        return RawField(displacement + answer, boundary + answer, forces)

    def _run(self, signal: PlanSignal) -> InterfaceAndVolume:
        def once(shown: PlanSignal) -> InterfaceAndVolume:
            return self.network(self.patient.anatomy, shown, rest=self._rest)

        if not signal.cue.is_cuda:
            return once(signal)
        if self._recorded is None:
            aside = torch.cuda.Stream()
            aside.wait_stream(torch.cuda.current_stream())
            with torch.cuda.stream(aside):  # compiles, and finds the layouts of the graphs
                once(signal)
            torch.cuda.current_stream().wait_stream(aside)
            graph = torch.cuda.CUDAGraph()
            with torch.cuda.graph(graph):
                output = once(signal)
            self._recorded = graph, signal, output
        graph, recorded, output = self._recorded
        for old, new in zip(vars(recorded).values(), vars(signal).values(), strict=True):
            if new is not None and new is not old:
                old.copy_(new)
        graph.replay()
        return output


def load_network(path: str | os.PathLike, device: str = "cpu") -> tuple[nn.Module, NetworkSettings]:
    """A trained graph network and its settings."""
    return read_network(path, NetworkSettings, build, device)


def load_sources(path: str | os.PathLike) -> SourceModel | None:
    """The sources that were learned with a network, if any."""
    state = load_tensors(path, "cpu").get("sources")
    return state and SourceModel.restored({name: value.numpy() for name, value in state.items()})
