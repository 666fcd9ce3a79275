"""One network of the study trained where its solvers, meshes and Snakemake are not installed, such as a GPU machine.

python tests/benchmarks/train_fold.py --cases training --out trained --fold 1 --method pinnochio
    --config config/config.yaml config/paper.yaml --device cuda [--seconds 480]

Reads what export_training.py writes of the fold's training patients below --cases (and their lifts, where the variant
has one) with torch, torch_geometric, numpy, scipy and h5py, and writes below --out/FOLD/METHOD what the study's rules
write: pretrained.pt, pretraining.csv, network.pt, finetuning.csv. Logs steps per second, prints the seconds of each
phase and the memory of the GPU. Killed, or stopped by --seconds, and started again it goes on; stopped, it leaves the
network of the steps that are done beside what it goes on from. --plain launches every kernel of every step.
"""

import argparse
import logging
import os
import sys
import time
from pathlib import Path

import torch

sys.path.insert(0, str(Path(__file__).parents[2] / "workflow"))
sys.path.insert(0, str(Path(__file__).parent))

from importlib import import_module

from configuration import read_config

from pinnochio.code import code_hash, source_file
from pinnochio.methods.registry import SURFACE_NETWORK, registry
from pinnochio.seeds import derive_seed
from pinnochio.study.cases import assign_folds, virtual_cases
from pinnochio.training.cases import case_files
from pinnochio.training.device import choose_device
from pinnochio.training.fold import train_fold
from pinnochio.training.settings import PHASES

NETWORKS = {"pretrain": "pretrained.pt", "finetune": "network.pt"}


def trained(out: Path, phase: str) -> bool:
    """Whether the phase has ended: its network is there, and nothing to go on from."""
    network = out / NETWORKS[phase]
    return network.is_file() and not network.with_suffix(".resume.pt").is_file()


def training_cases(config: dict, fold: str) -> list[str]:
    """The patients that the fold trains on."""
    own = config["virtual"]
    names = [case.name for case in virtual_cases(own["patients"], "", own["without"])]
    held_out = assign_folds(names, [], config["folds"], config["seed"])[fold]
    return [name for name in names if name not in held_out]


def kept(learner, phase: str, folder: Path):
    """The learner's `read`, which keeps what it makes of a patient's points: the same for all folds and starts."""
    read, name = learner.read, f"{learner.network.architecture}_{phase}"

    def again(files):
        path = folder / f"{name}_{files.case}.pt"
        if path.is_file():
            return torch.load(path, map_location=learner.device, weights_only=False)
        samples = read(files)
        folder.mkdir(parents=True, exist_ok=True)
        own = path.with_suffix(f".{os.getpid()}")  # other folds may be at the same patient
        torch.save(samples, own)
        os.replace(own, path)
        return samples

    return again


def train(config: dict, method: str, fold: str, cases: Path, out: Path, device: str, until: float, plain: bool) -> bool:
    """Train the method's network of the fold through its phases; whether the last one has ended by the time `until`."""
    own = registry(config)[method]
    names = training_cases(config, fold)

    def files(name):
        return [str(cases / case / name) for case in names]

    lifts = [] if own.lift == "none" else files(f"lift_{own.lift}.h5")
    read = {"pretrain": {"fem_samples": files("fem_samples.h5")}}
    read["finetune"] = {"plan": files("motion.json"), "postop": files("postop.h5")}
    code = code_hash(Path(__file__), source_file(own.learner))
    out.mkdir(parents=True, exist_ok=True)
    for phase, section in PHASES.items():
        if section not in own.settings or trained(out, phase):
            continue
        began = time.perf_counter()
        learner = import_module(own.learner).Learner(own.settings, phase, device)
        if plain:
            type(learner).recorded = False
        if own.learner == SURFACE_NETWORK.learner:
            learner.read = kept(learner, phase, out.parents[1] / "samples")
        pretrained = out / NETWORKS["pretrain"] if phase == "finetune" and "pretraining" in own.settings else None
        ended = train_fold(
            learner,
            phase,
            case_files(names, lifts, model=files("model.h5"), **read[phase]),
            pretrained,
            seed=derive_seed(config["seed"], phase, f"{fold}/{method}"),
            code=code,
            out=out / NETWORKS[phase],
            history=out / f"{section}.csv",
            until=until,
        )
        seconds = time.perf_counter() - began
        print(f"{method} {fold}: {section} {'done' if ended else 'stopped'}, {seconds:.0f} s with reading", flush=True)
        if not ended:
            return False
    return True


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cases", type=Path, required=True)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--fold", default="1")
    parser.add_argument("--method", default="pinnochio")
    parser.add_argument("--config", type=Path, nargs="+", default=[Path("config/config.yaml")])
    parser.add_argument("--device", default="cpu")
    parser.add_argument("--threads", type=int, default=1, help="of the processor")
    parser.add_argument("--seconds", type=float, default=1e9, help="after which it stops, to go on when started again")
    parser.add_argument("--plain", action="store_true", help="record no kernels")
    asked = parser.parse_args()
    until = time.monotonic() + asked.seconds
    device = choose_device(asked.device == "cuda", asked.threads)
    logging.basicConfig(level=logging.INFO, format="%(asctime)s %(message)s")
    out = asked.out / asked.fold / asked.method
    train(read_config(asked.config), asked.method, asked.fold, asked.cases, out, device, until, asked.plain)
    if device == "cuda":
        print(f"peak memory of the GPU: {torch.cuda.max_memory_allocated() / 2**30:.2f} GiB")


if __name__ == "__main__":
    main()
