"""Trains networks of the study on a machine with a GPU, without its solvers, meshes and Snakemake.

python workflow/train_networks.py export --results results --out training
python workflow/train_networks.py train --cases training --out trained --jobs acmt:1-5 pinnochio:1 --seconds 480
python workflow/train_networks.py halve --out trained halved

`export` makes what training reads, small enough to be carried. `train` reads it with torch, torch_geometric, numpy,
scipy, h5py and PyYAML, and writes below --out/FOLD/METHOD what the study's rules write: pretrained.pt,
pretraining.csv, network.pt, finetuning.csv. A job is a method and its folds. Each network has a process of its own,
--parallel at a time; a single one is trained in this process. All stop in time to be written, and the same command
goes on where they stopped; what has ended is left alone. A log lies beside each network. At the end a line per network:
steps done, and its last errors on the patients held back. `halve` copies networks with their matrices in half
precision, as archives of networks hold them (`workflow/pack_networks.py`).
"""

import argparse
import csv
import logging
import os
import shutil
import subprocess
import sys
import time
from pathlib import Path

import h5py
import numpy as np
import torch

from pinnochio.code import code_hash, source_file
from pinnochio.methods.registry import SURFACE_NETWORK, registry
from pinnochio.overlays import read_merged
from pinnochio.references import resolve
from pinnochio.seeds import derive_seed
from pinnochio.study.cohort import virtual_cases
from pinnochio.study.folds import assign_folds
from pinnochio.training.case_files import case_files
from pinnochio.training.device import choose_device
from pinnochio.training.fold import train_fold
from pinnochio.training.settings import PHASES

MARGIN = 20.0  # seconds that writing takes at the end
NEEDED = ("model.h5", "postop.h5")
MOTIONS = {"achieved": "achieved.json", "planned": "plan.json"}
FIELDS = "fem_samples.h5"
NETWORKS = {"pretrain": "pretrained.pt", "finetune": "network.pt"}
HISTORIES = ("pretraining.csv", "finetuning.csv")


def patients(config: dict) -> list[str]:
    """Names of the virtual patients of the study."""
    cohort = config["virtual"]
    return [case.name for case in virtual_cases(cohort["patients"], "", cohort["without"])]


def compact(source: Path, target: Path) -> None:
    """Copy an HDF5 file with its numbers rounded to float32 (8e-6 mm in a head), packed, under their old types."""
    with h5py.File(source) as old, h5py.File(target, "w") as new:
        new.attrs.update(old.attrs)

        def copy(name, item):
            if not isinstance(item, h5py.Dataset):
                new.require_group(name).attrs.update(item.attrs)
                return
            values = item[()]
            if values.dtype.kind == "f":
                values = values.astype(np.float32).astype(values.dtype)
            packed = {"compression": "gzip", "compression_opts": 9, "shuffle": True} if np.ndim(values) else {}
            new.create_dataset(name, data=values, track_times=False, **packed).attrs.update(item.attrs)

        old.visititems(copy)


def export(config: dict, cases: Path, out: Path, partial: bool) -> list[str]:
    """Write the files of the study's patients that are not there yet; names of the patients that are whole.

    FileNotFoundError where a patient's file is missing, unless what is there is enough (`partial`).
    """
    motion, done = MOTIONS[config["motion"]], []
    for name in patients(config):
        missing = [file for file in (*NEEDED, motion) if not (cases / name / file).is_file()]
        if missing and partial:
            continue
        if missing:
            raise FileNotFoundError(f"{cases / name}: {', '.join(missing)} not there yet")
        (out / name).mkdir(parents=True, exist_ok=True)
        shutil.copyfile(cases / name / motion, out / name / "motion.json")
        for file in (*NEEDED, FIELDS):
            source, target = cases / name / file, out / name / file
            current = target.is_file() and target.stat().st_mtime >= source.stat().st_mtime
            if source.is_file() and not current:
                compact(source, target)
        done.append(name)
    return done


def jobs(texts: list[str]) -> list[tuple[str, str]]:
    """Methods and folds of "method:1-5" or "method:2,4", fold by fold of a method."""
    pairs = []
    for text in texts:
        method, folds = text.split(":")
        for part in folds.split(","):
            first, _, last = part.partition("-")
            pairs += [(method, str(fold)) for fold in range(int(first), int(last or first) + 1)]
    return pairs


def ended(folder: Path, phase: str) -> bool:
    """Whether the phase has ended: its network is there, and nothing to go on from."""
    network = folder / NETWORKS[phase]
    return network.is_file() and not network.with_suffix(".resume.pt").is_file()


def kept(learner, phase: str, folder: Path):
    """The learner's `read`, which keeps what it makes of a patient's points: the same for all folds and starts."""
    read, name = learner.read, f"{learner.network.architecture}_{phase}"

    def again(files):
        path = folder / f"{name}_{files.case}.pt"
        if path.is_file():
            return torch.load(path, map_location=learner.device, weights_only=False)
        samples = read(files)
        folder.mkdir(parents=True, exist_ok=True)
        partial = path.with_suffix(f".{os.getpid()}")  # other folds may be at the same patient
        torch.save(samples, partial)
        os.replace(partial, path)
        return samples

    return again


def train(config: dict, method: str, fold: str, cases: Path, folder: Path, device: str, until: float, plain: bool):
    """Train the method's network of the fold through its phases, or as far as it gets by the time `until`."""
    chosen, names = registry(config)[method], patients(config)
    held_out = assign_folds(names, [], config["folds"], config["seed"])[fold]
    names = [name for name in names if name not in held_out]

    def files(name):
        return [str(cases / case / name) for case in names]

    lifts = [] if chosen.lift == "none" else files(f"lift_{chosen.lift}.h5")
    read = {"pretrain": {"fem_samples": files(FIELDS)}}
    read["finetune"] = {"plan": files("motion.json"), "postop": files("postop.h5")}
    code = code_hash(Path(__file__), source_file(chosen.learner))
    folder.mkdir(parents=True, exist_ok=True)
    for phase, section in PHASES.items():
        if section not in chosen.settings or ended(folder, phase):
            continue
        learner = resolve(chosen.learner)(chosen.settings, phase, device)
        if plain:
            type(learner).recorded = False
        if chosen.learner == SURFACE_NETWORK.learner:
            learner.read = kept(learner, phase, folder.parents[1] / "samples")
        pretrained = folder / NETWORKS["pretrain"] if phase == "finetune" and "pretraining" in chosen.settings else None
        if not train_fold(
            learner,
            phase,
            case_files(names, lifts, model=files("model.h5"), **read[phase]),
            pretrained,
            seed=derive_seed(config["seed"], phase, f"{fold}/{method}"),
            code=code,
            out=folder / NETWORKS[phase],
            history=folder / f"{section}.csv",
            until=until,
        ):
            return


def train_beside(pairs: list[tuple[str, str]], options: argparse.Namespace, until: float) -> None:
    """Train the networks of methods and folds in processes of their own, in this order, while there is time."""
    waiting, running = list(pairs), {}
    while running or waiting:
        while waiting and len(running) < options.parallel and time.monotonic() < until - 2 * MARGIN:
            method, fold = waiting.pop(0)
            folder = options.out / fold / method
            folder.mkdir(parents=True, exist_ok=True)
            command = [sys.executable, __file__, "train", "--cases", str(options.cases), "--out", str(options.out)]
            command += ["--jobs", f"{method}:{fold}", "--device", options.device]
            command += ["--seconds", f"{until - time.monotonic():.0f}", "--config", *map(str, options.config)]
            log = open(folder / "training.log", "a")  # noqa: SIM115 - closed with the process
            running[method, fold] = subprocess.Popen(command + ["--plain"] * options.plain, stdout=log, stderr=log), log
        if not running:
            break
        time.sleep(0.5)
        for (method, fold), (process, log) in list(running.items()):
            if process.poll() is not None:
                log.close()
                del running[method, fold]
                if process.returncode:
                    print(f"{method} {fold} failed:\n{Path(log.name).read_text()[-2000:]}", flush=True)


def progress(known: dict, method: str, fold: str, folder: Path) -> str:
    """A line about a network: steps done of those of its phases, its last errors on the patients held back."""
    line = []
    for phase, section in PHASES.items():
        if section not in known[method].settings:
            continue
        steps, history = known[method].settings[section]["steps"], folder / f"{section}.csv"
        rows = []
        if history.is_file():
            with open(history, newline="") as file:
                rows = list(csv.DictReader(file))
        if not rows:
            line.append(f"{section} 0 of {steps}")
            continue
        looks = [f"{float(row['validation']):.3g}" for row in rows if row["validation"] != "nan"]
        shown = looks[:: max(1, len(looks) // 6)][-7:] + looks[-1:]
        state = "ended" if ended(folder, phase) else "goes on"
        line.append(f"{section} {rows[-1]['step']} of {steps}, {state}, held back {' '.join(shown)}")
    return f"{method} {fold}: {'; '.join(line)}"


def halve(source: Path, target: Path) -> None:
    """Copy a network's file with its matrices in half precision; vectors and running statistics keep theirs."""
    stored = torch.load(source, map_location="cpu", weights_only=True)
    stored["state"] = {
        name: value.half() if value.is_floating_point() and value.ndim > 1 else value
        for name, value in stored["state"].items()
    }
    torch.save(stored, target)


def options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("action", choices=["export", "train", "halve"])
    parser.add_argument("halved", nargs="?", type=Path, help="halve: folder of the copies")
    parser.add_argument("--out", type=Path, required=True, help="folder of the networks; export: of the cases")
    parser.add_argument("--config", type=Path, nargs="+", default=[Path("config/config.yaml")])
    parser.add_argument("--results", type=Path, default=Path("results"), help="export: of the study")
    parser.add_argument("--partial", action="store_true", help="export: the patients that are there")
    parser.add_argument("--cases", type=Path, help="train: what export wrote")
    parser.add_argument("--jobs", nargs="+", default=[], help="train: METHOD:FOLDS, as 1-5 or 2,4")
    parser.add_argument("--parallel", type=int, default=10, help="train: networks at a time")
    parser.add_argument("--seconds", type=float, default=1e9, help="train: after which it stops, to be gone on with")
    parser.add_argument("--device", default="cuda", choices=["cuda", "cpu"])
    parser.add_argument("--plain", action="store_true", help="train: record no kernels")
    return parser.parse_intermixed_args()


def main(chosen: argparse.Namespace) -> None:
    config = read_merged(chosen.config)
    if chosen.action == "export":
        done = export(config, chosen.results / "cases", chosen.out, chosen.partial)
        size = sum(file.stat().st_size for name in done for file in (chosen.out / name).iterdir()) / 2**20
        print(f"{len(done)} of {len(patients(config))} patients, {size:.1f} MiB")
    elif chosen.action == "halve":
        for network in sorted(chosen.out.glob(f"*/*/{NETWORKS['finetune']}")):
            target = chosen.halved / network.parent.relative_to(chosen.out)
            target.mkdir(parents=True, exist_ok=True)
            halve(network, target / network.name)
            for name in HISTORIES:
                if (network.parent / name).is_file():
                    shutil.copyfile(network.parent / name, target / name)
    else:
        pairs, until = jobs(chosen.jobs), time.monotonic() + chosen.seconds
        missing = [(method, fold) for method, fold in pairs if not ended(chosen.out / fold / method, "finetune")]
        if len(pairs) == 1:
            logging.basicConfig(level=logging.INFO, format="%(asctime)s %(message)s")
            device = choose_device(chosen.device == "cuda", 1)
            for method, fold in missing:
                folder = chosen.out / fold / method
                train(config, method, fold, chosen.cases, folder, device, until - MARGIN, chosen.plain)
        else:
            train_beside(missing, chosen, until)
        known = registry(config)
        for method, fold in pairs:
            print(progress(known, method, fold, chosen.out / fold / method))


if __name__ == "__main__":
    main(options())
