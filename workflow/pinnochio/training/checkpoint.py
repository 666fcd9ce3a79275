"""Trained networks and half-trained states on disk."""

import hashlib
import os
import zipfile
from collections.abc import Callable, Iterable
from dataclasses import asdict
from typing import TypeVar

import torch
from torch import nn

from pinnochio.errors import REMEDY, InputError
from pinnochio.files import replacing

Settings = TypeVar("Settings")  # a dataclass of plain values


def save_network(path: str | os.PathLike, network: nn.Module, settings: Settings, **about) -> None:
    """Write the weights with the settings that rebuild the network, and plain values `about` the training."""
    save_state(path, {"network": asdict(settings), "state": network.state_dict(), **about})


def read_network(
    path: str | os.PathLike, kind: type[Settings], build: Callable[[Settings], nn.Module], device: torch.device | str
) -> tuple[nn.Module, Settings]:
    """Network on `device` and its settings, of a `kind` that build(settings) makes it of.

    Nothing but tensors and plain values is unpickled.
    """
    stored = load_tensors(path, device)
    try:
        removed = getattr(kind, "REMOVED", {}).items()
        settings = kind(**{name: value for name, value in stored["network"].items() if (name, value) not in removed})
        network = build(settings).to(device)
        network.load_state_dict(stored["state"])
    except (KeyError, TypeError, ValueError, RuntimeError) as error:
        raise InputError("-", path, f"it is no network of this kind ({_reason(error)})", REMEDY) from error
    return network, settings


def load_tensors(path: str | os.PathLike, device: torch.device | str) -> dict:
    """The dictionary of tensors and plain values in a file of torch; InputError where it is damaged."""
    try:
        with zipfile.ZipFile(path) as archive:  # torch itself does not look at the checksums
            if wrong := archive.testzip():
                raise ValueError(f"{wrong} is damaged")
        return torch.load(path, map_location=device, weights_only=True)
    except torch.OutOfMemoryError:
        raise
    except Exception as error:  # torch, zip and pickle raise what they like
        raise InputError("-", path, f"it cannot be read ({_reason(error)})", REMEDY) from error


def _reason(error: Exception) -> str:
    return (str(error).strip() or type(error).__name__).splitlines()[0][:160]


def save_state(path: str | os.PathLike, state: dict) -> None:
    """Write a dictionary of tensors and plain values, all or nothing; the same state gives the same bytes.

    Through an open file, because torch stores the name of a path that it opens itself.
    """
    with replacing(path) as temporary, open(temporary, "wb") as file:
        torch.save(state, file)
        file.flush()
        os.fsync(file.fileno())


def load_state(path: str | os.PathLike, signature: str, device: torch.device | str) -> dict | None:
    """The state at `path` if it is there and was written under the same `signature`."""
    if not os.path.exists(path):
        return None
    state = load_tensors(path, device)
    return state if state["signature"] == signature else None


def fingerprint(network: nn.Module, inputs: Iterable[str | os.PathLike], code: str) -> str:
    """Hash of the weights and of the content of the files `inputs`, and the hash `code` of what trains."""
    digest = hashlib.sha256()
    for name, value in network.state_dict().items():
        digest.update(name.encode() + b"\0" + value.cpu().numpy().tobytes())
    for path in inputs:
        with open(path, "rb") as file:
            digest.update(hashlib.file_digest(file, "sha256").digest())
    return digest.hexdigest() + code
