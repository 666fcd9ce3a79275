"""One plan of one patient, warm, by finite elements, the elastic path and the networks, in one run.

python tests/benchmarks/predict.py --case results/cases/V01 --fold results/folds/1 [--threads 2] [--device cuda]

Reads model.h5 and plan.json of the case and the trained networks of the fold (of a patient's fold that held it out or
not: only the time counts). The methods take turns. "network" is the field as the network gives it, "delivered" what
the study writes: repaired, and corrected as often as the variant says. Prints medians in ms, the ratio to fem_sliding
of the same run, and what each method computes once per patient. --without-fem leaves the solvers out, on a machine
that lacks them; --untrained takes networks of the configuration with random weights, whose fields are not finished.
"""

import argparse
import os
import sys
import time
from pathlib import Path

os.environ |= {"OMP_WAIT_POLICY": "passive", "OPENBLAS_NUM_THREADS": "1"}  # as the study does

import numpy as np
import torch

sys.path.insert(0, str(Path(__file__).parents[2]))
sys.path.insert(0, str(Path(__file__).parents[2] / "workflow"))

from pinnochio.mechanics.boundary.conditions import boundary_conditions
from pinnochio.mechanics.lift import Lift, make_lift
from pinnochio.mechanics.settings import FemSettings
from pinnochio.mechanics.simulation import simulate
from pinnochio.mechanics.solvers.linear_elasticity import ElasticSolver
from pinnochio.mechanics.solvers.newton_corrections import Finish
from pinnochio.methods.pinnochio.patient import tensors
from pinnochio.methods.pinnochio.predictor import PatientGraphNetwork, load_network
from pinnochio.methods.registry import graph_networks
from pinnochio.model.patient import PatientModel
from pinnochio.networks.building import build
from pinnochio.networks.settings import NetworkSettings
from pinnochio.overlays import read_merged
from pinnochio.plans.plan import Plan
from tests.helpers.settings import network_settings


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--case", type=Path, required=True)
    parser.add_argument("--fold", type=Path)
    parser.add_argument("--methods", nargs="+", default=["pinnochio", "pinnochio_plus"])
    parser.add_argument("--config", type=Path, nargs="+", default=[Path("config/config.yaml")])
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument("--device", default="cpu")
    parser.add_argument("--without-fem", action="store_true")
    parser.add_argument("--untrained", action="store_true")
    asked = parser.parse_args()
    torch.set_num_threads(asked.threads)
    config = read_merged(asked.config)
    fem, settings = FemSettings(**config["fem"]), graph_networks(config)
    model = PatientModel.read(asked.case / "model.h5")
    plan = Plan.from_json((asked.case / "plan.json").read_text(encoding="utf-8"), asked.case / "plan.json")
    ways, setup = {}, {}
    if not asked.without_fem:
        boundary = boundary_conditions(model, plan, "mucosa")
        began = time.perf_counter()
        elastic = ElasticSolver(model.points, model.cells, fem.material(model.tissue), boundary, fem.volumetric)
        setup["elastic"] = time.perf_counter() - began
        ways["fem_sliding"] = lambda: simulate(model, [plan], fem)
        ways["elastic"] = lambda: elastic.solve(boundary_conditions(model, plan, "mucosa"))
    for method in asked.methods:
        own = network_settings(**settings[method]["network"])
        network = shaken(own, asked.device) if asked.untrained else None
        if network is None:
            network, own = load_network(asked.fold / method / "network.pt", asked.device)
        began = time.perf_counter()
        lift = None if own.lift == "none" else read_lift(asked.case, model, fem, own.lift, config["lift"]["controls"])
        predictor = PatientGraphNetwork(network, tensors(model, fem, own, asked.device, lift))
        predictor(plan)
        setup[method] = time.perf_counter() - began
        ways[f"{method}, network"] = lambda predictor=predictor: predictor(plan)
        if not asked.untrained:
            finish = Finish(model, fem, settings[method]["newton_corrections"])
            ways[f"{method}, delivered"] = lambda predictor=predictor, finish=finish: finish(*predictor(plan))
    seconds = {name: [] for name in ways}
    for repeat in range(asked.repeats + 1):
        for name, way in ways.items():
            began = time.perf_counter()
            way()
            if repeat:  # the first round compiles and allocates
                seconds[name].append(time.perf_counter() - began)
    print(f"{asked.case}: {len(model.points)} nodes, {len(model.bone_points)} bone points, {asked.threads} threads")
    reference = np.median(seconds.get("fem_sliding", [np.nan]))
    for name, values in seconds.items():
        middle = np.median(values)
        print(f"{name:32s} {1e3 * middle:9.1f} ms   fem_sliding / this {reference / middle:8.1f}")
    for name, value in setup.items():
        print(f"{name:32s} {value:9.2f} s once per patient")


def read_lift(case: Path, model: PatientModel, fem: FemSettings, kind: str, controls: int) -> Lift:
    """The lift beside the model, or a new one."""
    path = case / f"lift_{kind}.h5"
    if path.is_file():
        return Lift.read(path)
    return make_lift(model, fem.material(model.tissue), kind, controls, fem.volumetric)


def shaken(settings: NetworkSettings, device: str) -> torch.nn.Module:
    """A network with random weights; its decoders, which start at zero, give hundredths of a millimetre."""
    torch.manual_seed(0)
    network = build(settings)
    with torch.no_grad():
        for weight in network.parameters():
            if not weight.any():
                weight.normal_(0, 1e-3)
    return network.to(device).eval()


if __name__ == "__main__":
    main()
