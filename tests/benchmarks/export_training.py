"""Makes the files that train_fold.py reads, small enough to carry to a machine with a GPU.

python tests/benchmarks/export_training.py --results results --out training [--config config/config.yaml ...]

Of every patient with a post-operative scan: model.h5, the motion that training takes (motion.json: achieved or
planned), postop.h5 and, where it is there, fem_samples.h5. Numbers are rounded to float32, at most 8e-6 mm in a head,
and packed; nothing else is left out, so every reader of the study reads them. Prints the size in MiB, and fails where a
patient's files are not there yet (--partial takes what is there).
"""

import argparse
import shutil
import sys
from pathlib import Path

import h5py
import numpy as np

sys.path.insert(0, str(Path(__file__).parents[2] / "workflow"))
sys.path.insert(0, str(Path(__file__).parent))

from configuration import read_config

from pinnochio.study.cases import virtual_cases

NEEDED = ("model.h5", "postop.h5")
MOTIONS = {"achieved": "achieved.json", "planned": "plan.json"}
FIELDS = "fem_samples.h5"


def compact(source: Path, target: Path) -> None:
    """Copy an HDF5 file with float32 numbers, packed, under their own types."""
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


def export(cases: Path, names: list[str], motion: str, out: Path, partial: bool) -> list[str]:
    """Write the files of the named patients that are not there yet; their names. FileNotFoundError where something is
    missing."""
    done = []
    for name in names:
        missing = [file for file in (*NEEDED, MOTIONS[motion]) if not (cases / name / file).is_file()]
        if missing and partial:
            continue
        if missing:
            raise FileNotFoundError(f"{cases / name}: {', '.join(missing)} not there yet")
        (out / name).mkdir(parents=True, exist_ok=True)
        shutil.copyfile(cases / name / MOTIONS[motion], out / name / "motion.json")
        for file in (*NEEDED, FIELDS):
            source, target = cases / name / file, out / name / file
            there = target.is_file() and target.stat().st_mtime >= source.stat().st_mtime
            if source.is_file() and not there:
                compact(source, target)
        done.append(name)
    return done


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--results", type=Path, default=Path("results"))
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--config", type=Path, nargs="+", default=[Path("config/config.yaml")])
    parser.add_argument("--partial", action="store_true", help="take the patients that are there")
    asked = parser.parse_args()
    config = read_config(asked.config)
    own = config["virtual"]
    names = [case.name for case in virtual_cases(own["patients"], "", own["without"])]
    done = export(asked.results / "cases", names, config["motion"], asked.out, asked.partial)
    files = [file for name in done for file in (asked.out / name).iterdir()]
    fields = sum(file.name == FIELDS for file in files)
    size = sum(file.stat().st_size for file in files) / 2**20
    print(f"{len(done)} of {len(names)} patients, {fields} with finite-element fields, {size:.1f} MiB")


if __name__ == "__main__":
    main()
