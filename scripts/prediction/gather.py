"""Makes one folder of a kind of file of a fold's held-out patients."""

import os
import shutil
from collections.abc import Iterable
from pathlib import Path

from pinnochio.logs import attach_log


def gather(files: Iterable[str], names: Iterable[str], folder: str) -> None:
    """Put the files there by these names: they take no room where the disk knows hard links."""
    Path(folder).mkdir(parents=True, exist_ok=True)
    for file, name in zip(files, names, strict=True):
        target = Path(folder, name)
        try:
            os.link(file, target)
        except OSError:
            shutil.copy2(file, target)


if __name__ == "__main__":
    attach_log(snakemake.log[0])
    gather(files=snakemake.input, names=snakemake.params.names, folder=snakemake.output.folder)
