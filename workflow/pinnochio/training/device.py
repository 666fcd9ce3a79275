"""The device that a stage computes on."""

import os

import torch


def choose_device(gpus: int, threads: int) -> str:
    """ "cuda" if a GPU is granted and there is one, else "cpu" with that many threads."""
    torch.set_num_threads(threads)
    # Without a fixed workspace cuBLAS may sum in another order from run to run; read when CUDA starts.
    os.environ.setdefault("CUBLAS_WORKSPACE_CONFIG", ":4096:8")
    return "cuda" if gpus and torch.cuda.is_available() else "cpu"
