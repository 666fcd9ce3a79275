"""Prediction by a trained graph network, whose fields are repaired and corrected before they are returned."""

import logging
import os
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
import torch
from torch import nn

from pinnochio.mechanics.held_face import SHARES, HeldFace
from pinnochio.mechanics.settings import FemSettings
from pinnochio.mechanics.solvers.inversion_repair import Repair
from pinnochio.mechanics.solvers.newton_corrections import EQUILIBRIUM, Finish
from pinnochio.methods.pinnochio.patient import PatientTensors, tensors
from pinnochio.methods.protocol import Planned
from pinnochio.methods.sources import PatientSources, SourceModel
from pinnochio.model.patient import PatientModel
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
        finishing = planned.once(Finishing, planned.patient, self._fem, self._corrections)

        def prepare():
            network, sources = planned.once(self._of_patient, planned)

            def predict():
                raw = network(planned.plan)
                return raw, finishing(raw, None if planned.plan.still else sources)

            return predict

        (raw, finished), seconds, setup = timed(prepare, planned.warm)
        logging.info("%s: %s", planned.case, finished.repair)
        return Prediction(
            finished.displacement,
            seconds,
            setup + (planned.lift.seconds if planned.lift else 0.0),
            self._threads,
            self._device,
            iterations=finished.corrections,
            boundary=finished.boundary,
            raw=raw.displacement,
            forces=finished.forces,
            repaired=finished.repair.elements,
            damping=finished.repair.damping,
        )

    def _of_patient(self, planned: Planned) -> tuple["PatientGraphNetwork", PatientSources | None]:
        patient = planned.once(tensors, planned.patient, self._fem, self._settings, self._device, planned.lift)
        sources = self._learned and PatientSources(self._learned, planned.patient)
        return PatientGraphNetwork(self.network, patient), sources


class RawField(NamedTuple):
    """What a network says of a plan: displacement (n, 3) mm of every node, and of the interface nodes as P_bnd gives
    it."""

    displacement: np.ndarray
    boundary: np.ndarray


class Finished(NamedTuple):
    """A field (n, 3) mm that is given out, one (n, 3) mm that says where its interface was put, the load (n, 3) mN that
    it declares or None, what the inversion repair did, and how many corrections were made."""

    displacement: np.ndarray
    boundary: np.ndarray
    forces: np.ndarray | None
    repair: Repair
    corrections: int


class Finishing:
    """The end of every network's prediction on one patient: the field is repaired and corrected and then, where sources
    were learned with the network, its face held where they say, and corrected again."""

    def __init__(self, patient: PatientModel, fem: FemSettings, steps: int):
        self._held = HeldFace(patient, fem)
        self._free, self._holding = Finish(patient, fem, steps), Finish(patient, fem, steps, self._held.loads)

    def first_look(self, raw: RawField, sources: PatientSources | None) -> np.ndarray:
        """The field (n, 3) mm to first order, nothing repaired or corrected."""
        if sources is None:
            return raw.displacement
        return raw.displacement + self._held.answer(sources(raw.displacement))

    def __call__(self, raw: RawField, sources: PatientSources | None = None, alike: bool = False) -> Finished:
        """alike: another network's field of the same plan was finished just before."""
        base, repair, made = self._free(*raw, alike=alike)
        if sources is None:
            return Finished(base, raw.boundary, None, repair, made)
        wanted = sources(base)
        answer = self._held.answer(wanted)
        for share in SHARES:
            start, pull = base + share * answer, self._held.pull(share * wanted, base)
            states, again = self._holding.all(start, start, pull, alike)
            made += len(states) - 1
            if not (states[-1].residual > EQUILIBRIUM and states[-1].share < 1):  # else they do not get on
                break
        field = states[-1].displacement
        return Finished(field, start, self._held.force(pull, field), max(repair, again, key=_size), made)


def _size(repair: Repair) -> tuple[float, int]:
    return -repair.damping, repair.elements


class PatientGraphNetwork:
    """A trained network on one patient: what belongs to the patient is computed once and serves every plan.

    On a GPU the first plan records the kernels, and every later one replays them without the cost of their launches.
    """

    def __init__(self, network: nn.Module, patient: PatientTensors):
        self.network, self.patient, self._recorded = network, patient, None
        with torch.inference_mode():
            self._rest = network.encode_rest(patient.anatomy)

    def __call__(self, plan: Plan) -> RawField:
        """The field, float64; exactly zero for a plan that moves nothing.

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
        return RawField(displacement, boundary)

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
