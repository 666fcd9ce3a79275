"""The device that a stage computes on."""

import fcntl
import itertools
import os
import sys
import tempfile
from pathlib import Path

from pinnochio.references import resolve

_TAKEN = []  # locks of this process


def choose_device(gpus: int, threads: int) -> str:
    """ "cuda", the least used GPU, if one is granted and there is one, else "cpu" with that many threads."""
    import torch  # two seconds, which a method without networks is spared

    torch.set_num_threads(threads)
    # Without a fixed workspace cuBLAS may sum in another order from run to run; read when CUDA starts.
    os.environ.setdefault("CUBLAS_WORKSPACE_CONFIG", ":4096:8")
    if not (gpus and torch.cuda.is_available()):
        return "cpu"
    torch.cuda.set_device(least_used(torch.cuda.device_count()))
    return "cuda"


def least_used(gpus: int) -> int:
    """Number of the GPU that fewest of the user's processes have taken, which this one takes until it ends."""
    for turn in itertools.count():
        for gpu in range(gpus):
            file = open(Path(tempfile.gettempdir()) / f"pinnochio-{os.getuid()}-gpu{gpu}-{turn}", "w")  # noqa: SIM115
            try:
                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                file.close()
                continue
            _TAKEN.append(file)
            return gpu


def device_of(predictor: str, gpus: int, threads: int) -> str:
    """The device for a method by the reference of its predictor: "cpu" where it does not import torch."""
    resolve(predictor)
    return choose_device(gpus, threads) if "torch" in sys.modules else "cpu"
