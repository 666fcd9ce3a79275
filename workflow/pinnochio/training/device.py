"""The device that a stage computes on."""

import torch


def choose_device(gpus: int, threads: int) -> str:
    """ "cuda" if a GPU is granted and there is one, else "cpu" with that many threads."""
    torch.set_num_threads(threads)
    return "cuda" if gpus and torch.cuda.is_available() else "cpu"
