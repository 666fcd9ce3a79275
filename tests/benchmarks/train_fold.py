"""One fold of the study trained where its solvers, meshes and Snakemake are not installed, such as a bare GPU machine.

python tests/benchmarks/train_fold.py --cases results/paper/cases --out fold --fold 1 --method pinnochio
    --config config/config.yaml config/paper.yaml --device cuda

Reads model.h5, fem_samples.h5, plan.json and postop.h5 of the fold's training patients below --cases (and their lifts,
where the variant has one) with torch, torch_geometric, numpy, scipy and h5py, and writes what the study's rules write:
pretrained.pt, pretraining.csv, network.pt, finetuning.csv. Logs steps per second, prints the seconds of each phase and
the memory of the GPU. Killed, by `timeout` before a machine is taken away, and started again it goes on.
"""

import argparse
import logging
import sys
import time
from functools import partial
from pathlib import Path

import torch

sys.path.insert(0, str(Path(__file__).parents[2]))
sys.path.insert(0, str(Path(__file__).parents[2] / "workflow"))

from configuration import read_config

from pinnochio.code import code_hash, source_file
from pinnochio.methods.registry import graph_networks
from pinnochio.seeds import derive_seed
from pinnochio.study.cases import assign_folds, virtual_cases
from scripts.finetune import finetune
from scripts.pretrain import pretrain

MODULE = "pinnochio.methods.pinnochio.learner"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cases", type=Path, required=True)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--fold", default="1")
    parser.add_argument("--method", default="pinnochio")
    parser.add_argument("--config", type=Path, nargs="+", default=[Path("config/config.yaml")])
    parser.add_argument("--device", default="cpu")
    parser.add_argument("--threads", type=int, default=1, help="of the processor")
    asked = parser.parse_args()
    torch.set_num_threads(asked.threads)
    config = read_config(asked.config)
    settings = graph_networks(config)[asked.method]
    names = [case.name for case in virtual_cases(config["virtual"]["patients"], "")]
    held_out = assign_folds(names, [], config["folds"], config["seed"])[asked.fold]
    cases = [name for name in names if name not in held_out]
    asked.out.mkdir(parents=True, exist_ok=True)
    logging.basicConfig(level=logging.INFO, format="%(asctime)s %(message)s")

    def files(name):
        return [str(asked.cases / case / name) for case in cases]

    lift = settings["network"]["lift"]
    lifts = [] if lift == "none" else files(f"lift_{lift}.h5")
    common = {
        "module": MODULE,
        "settings": settings | {"fem": config["fem"]},
        "cases": cases,
        "models": files("model.h5"),
        "lifts": lifts,
        "code": code_hash(Path(__file__), source_file(MODULE)),
        "device": asked.device,
    }
    samples = {"fem_samples": files("fem_samples.h5")}
    outcomes = {"plans": files("plan.json"), "postops": files("postop.h5"), "pretrained": asked.out / "pretrained.pt"}
    phases = {
        "pretraining": ("pretrained.pt", "pretrain", partial(pretrain, **common, **samples)),
        "finetuning": ("network.pt", "finetune", partial(finetune, **common, **outcomes)),
    }
    for name, (network, phase, train) in phases.items():
        if (asked.out / network).is_file():
            print(f"{name}: already there")
            continue
        began = time.perf_counter()
        outputs = {"network": str(asked.out / network), "history": str(asked.out / f"{name}.csv")}
        train(seed=derive_seed(config["seed"], phase, f"{asked.fold}/{asked.method}"), outputs=outputs)
        print(f"{name}: {settings[name]['steps']} steps, {time.perf_counter() - began:.0f} s with reading")
    if asked.device == "cuda":
        print(f"peak memory of the GPU: {torch.cuda.max_memory_allocated() / 2**30:.2f} GiB")


if __name__ == "__main__":
    main()
