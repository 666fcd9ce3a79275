"""Seeds that depend on what is drawn, not on the order in which jobs run."""

import hashlib

import numpy as np


def derive_seed(base: int, stage: str, key: str) -> int:
    """63-bit seed from (base seed, stage, key), the same on every machine and Python version."""
    digest = hashlib.sha256(f"{base}/{stage}/{key}".encode()).digest()
    return int.from_bytes(digest[:8], "big") >> 1


def generator(base: int, stage: str, key: str) -> np.random.Generator:
    """NumPy generator seeded with :func:`derive_seed`."""
    return np.random.default_rng(derive_seed(base, stage, key))
