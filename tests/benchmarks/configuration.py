"""The configuration of a study as the benchmarks read it."""

from collections.abc import Iterable
from functools import reduce
from pathlib import Path

import yaml

from pinnochio.overlays import overlaid


def read_config(paths: Iterable[Path]) -> dict:
    """The first file with the values of the others over its own, as `--configfile` puts them."""
    return reduce(overlaid, (yaml.safe_load(path.read_text(encoding="utf-8")) for path in paths))
