"""The device that a stage computes on."""

import os
import sys

from pinnochio.references import resolve


def choose_device(gpus: int, threads: int) -> str:
    """ "cuda" if a GPU is granted and there is one, else "cpu" with that many threads."""
    import torch  # two seconds, which a method without networks is spared

    torch.set_num_threads(threads)
    # Without a fixed workspace cuBLAS may sum in another order from run to run; read when CUDA starts.
    os.environ.setdefault("CUBLAS_WORKSPACE_CONFIG", ":4096:8")
    return "cuda" if gpus and torch.cuda.is_available() else "cpu"


def device_of(predictor: str, gpus: int, threads: int) -> str:
    """The device for a method by the reference of its predictor: "cpu" where it does not import torch."""
    resolve(predictor)
    return choose_device(gpus, threads) if "torch" in sys.modules else "cpu"
