"""What a run needs of memory and disk: said before it starts, and refused where the machine has less."""

import os
import shutil
from collections import defaultdict
from collections.abc import Collection
from pathlib import Path

import psutil

from pinnochio.errors import InputError, StorageError
from pinnochio.files import ROOM

# Share of the memory that a job asks a cluster for; those of the locked study took 0.42 of it at most [X].
USED = 0.42
# MB that a job leaves where the mesh has 5,000 nodes [X]; it grows with them [I]. Jobs of other rules leave little.
LEFT = {"virtual_outcome": 4, "import_case": 1, "model_case": 31, "model_patient": 29, "make_lift": 27, "follow_up": 2}
LEFT |= {"pretrain": 1.5, "finetune": 1.5, "predict_cases": 2, "predict_both_motions": 4}
CONTAINER = Path("/sys/fs/cgroup/memory.max")
Jobs = Collection[tuple[str, int, int]]  # rule, MB of memory that it asks for, threads


def check_needs(jobs: Jobs, cores: int, nodes: int, results: str | os.PathLike) -> str:
    """What the jobs need, in words; InputError where memory does not suffice, StorageError where the disk does not.

    nodes: of a patient's mesh.
    """
    memory, there = at_once(jobs, cores), machine_memory()
    disk = sum(LEFT.get(rule, 0) for rule, *_ in jobs) * nodes / 5000
    place = next(filter(Path.is_dir, [Path(results), *Path(results).absolute().parents]))
    free = (shutil.disk_usage(place).free - ROOM) / 1e6
    if memory > there:
        problem = f"it takes up to {size(memory)} of memory, and there are {size(there)}. Nothing was started"
        remedy = f"give fewer --cores: one job at a time takes {size(at_once(jobs, 0))}"
        raise InputError("-", results, problem, remedy)
    if disk > free:
        problem = f"{size(disk)} will be written there, and {size(free)} are free. Nothing was started"
        raise StorageError(results, problem, "make room on its disk, or choose another results folder (pathvars)")
    return (
        f"Takes up to {size(memory)} of memory, of {size(there)}, and {size(disk)} in {results}, of {size(free)} free."
    )


def at_once(jobs: Jobs, cores: int) -> float:
    """MB that the largest jobs of one rule take side by side, of one job at least."""
    taken, free = defaultdict(float), defaultdict(lambda: cores)
    for rule, wanted, threads in sorted(jobs, key=lambda job: job[1], reverse=True):
        if rule not in taken or threads <= free[rule]:
            taken[rule] += USED * wanted
            free[rule] -= threads
    return max(taken.values(), default=0.0)


def size(megabytes: float) -> str:
    """Memory or disk as people say it."""
    return f"{megabytes:.0f} MB" if megabytes < 1000 else f"{megabytes / 1000:.1f} GB"


def machine_memory() -> float:
    """MB of this machine, or of the container that this process runs in."""
    limit = CONTAINER.read_text().strip() if CONTAINER.is_file() else "max"
    total = psutil.virtual_memory().total
    return (min(total, int(limit)) if limit.isdigit() else total) / 1e6
