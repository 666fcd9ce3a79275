"""Several networks of the study trained side by side on one GPU, for a limited time, to be gone on with.

python tests/benchmarks/train_networks.py --cases training --out trained --jobs acmt:1-5 dgcfp:1-5 pinnochio:1
    --parallel 10 --seconds 480 --device cuda --config config/config.yaml config/reference.yaml

Each job is a method and its folds; train_fold.py does each in a process of its own, so many at a time, in this order.
All stop in time to be written, and the same command goes on where they stopped; what has ended is left alone. A log of
each lies beside its networks. At the end a line per network: steps done of those asked for, and its last errors on the
patients held back.

--pack FOLDER METHODS: no training; the networks of these methods, as they are, with matrices in half precision, and
their histories are put into FOLDER as networks.tar.gz, cut into parts of 15.8 MiB, four at most; what does not fit is
named. `cat networks.tar.gz.* | tar xz` makes FOLD/METHOD/ of them again.
"""

import argparse
import csv
import gzip
import io
import subprocess
import sys
import tarfile
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[2] / "workflow"))
sys.path.insert(0, str(Path(__file__).parent))

import torch
from configuration import read_config
from train_fold import trained

from pinnochio.methods.registry import registry
from pinnochio.training.settings import PHASES

MARGIN = 20.0  # seconds that writing takes at the end
PART, PARTS = int(15.8 * 2**20), 4
FILES = ("network.pt", "finetuning.csv", "pretraining.csv")


def jobs(asked: list[str]) -> list[tuple[str, str]]:
    """Methods and folds of "method:1-5" or "method:2,4", fold by fold of a method."""
    pairs = []
    for text in asked:
        method, folds = text.split(":")
        for part in folds.split(","):
            first, _, last = part.partition("-")
            pairs += [(method, str(fold)) for fold in range(int(first), int(last or first) + 1)]
    return pairs


def train(asked: argparse.Namespace) -> None:
    """Do what there is time for."""
    until = time.monotonic() + asked.seconds
    waiting, running = jobs(asked.jobs), {}
    waiting = [(method, fold) for method, fold in waiting if not trained(asked.out / fold / method, "finetune")]
    while running or waiting:
        while waiting and len(running) < asked.parallel and time.monotonic() < until - 2 * MARGIN:
            job = method, fold = waiting.pop(0)
            folder = asked.out / fold / method
            folder.mkdir(parents=True, exist_ok=True)
            command = [sys.executable, str(Path(__file__).parent / "train_fold.py"), "--cases", str(asked.cases)]
            command += ["--out", str(asked.out), "--fold", fold, "--method", method, "--device", asked.device]
            command += ["--seconds", f"{until - MARGIN - time.monotonic():.0f}", "--config", *map(str, asked.config)]
            log = open(folder / "training.log", "a")  # noqa: SIM115 - closed with the process
            running[job] = subprocess.Popen(command + ["--plain"] * asked.plain, stdout=log, stderr=log), log
        if not running:
            break
        time.sleep(0.5)
        for job, (process, log) in list(running.items()):
            if process.poll() is not None:
                log.close()
                del running[job]
                if process.returncode:
                    text = Path(log.name).read_text()[-2000:]
                    print(f"{job[0]} {job[1]} failed:\n{text}", flush=True)


def report(asked: argparse.Namespace) -> None:
    """A line per network."""
    known = registry(read_config(asked.config))
    for method, fold in jobs(asked.jobs):
        folder, line = asked.out / fold / method, []
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
            done = "ended" if trained(folder, phase) else "goes on"
            shown = looks[:: max(1, len(looks) // 6)][-7:] + looks[-1:]
            line.append(f"{section} {rows[-1]['step']} of {steps}, {done}, held back {' '.join(shown)}")
        print(f"{method} {fold}: {'; '.join(line)}")


def halved(path: Path) -> bytes:
    """A network's file with its matrices in half precision; vectors and running statistics keep theirs."""
    stored = torch.load(path, map_location="cpu", weights_only=True)
    stored["state"] = {
        name: value.half() if value.is_floating_point() and value.ndim > 1 else value
        for name, value in stored["state"].items()
    }
    written = io.BytesIO()
    torch.save(stored, written)
    return written.getvalue()


def pack(asked: argparse.Namespace) -> None:
    """Write the parts."""
    folder, *methods = asked.pack
    packed, room = io.BytesIO(), PARTS * PART
    with tarfile.open(fileobj=packed, mode="w:gz") as archive:
        for method in methods:
            for home in sorted(path for path in asked.out.glob(f"*/{method}") if (path / FILES[0]).is_file()):
                content = {name: (home / name).read_bytes() for name in FILES[1:] if (home / name).is_file()}
                content[FILES[0]] = halved(home / FILES[0])
                size = sum(len(gzip.compress(data)) + 1024 for data in content.values())
                if size > room:
                    print(f"left out, for want of room: {method} {home.parent.name}")
                    continue
                room -= size
                for name, data in content.items():
                    about = tarfile.TarInfo(f"{home.parent.name}/{method}/{name}")
                    about.size = len(data)
                    archive.addfile(about, io.BytesIO(data))
                print(f"packed: {method} {home.parent.name}, {size / 2**20:.1f} MiB")
    data = packed.getvalue()
    Path(folder).mkdir(parents=True, exist_ok=True)
    for number, start in enumerate(range(0, len(data), PART)):
        (Path(folder) / f"networks.tar.gz.{number}").write_bytes(data[start : start + PART])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cases", type=Path)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--jobs", nargs="+", default=[])
    parser.add_argument("--config", type=Path, nargs="+", default=[Path("config/config.yaml")])
    parser.add_argument("--parallel", type=int, default=10)
    parser.add_argument("--seconds", type=float, default=480)
    parser.add_argument("--device", default="cuda")
    parser.add_argument("--plain", action="store_true", help="record no kernels")
    parser.add_argument("--pack", nargs="+", help="folder, and methods")
    asked = parser.parse_args()
    if asked.pack:
        return pack(asked)
    train(asked)
    return report(asked)


if __name__ == "__main__":
    main()
