"""Packs trained networks as an archive that studies take them from: `python workflow/pack_networks.py --help`."""

import argparse
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path

from pinnochio.code import ROOT, code_hash, source_file
from pinnochio.errors import InputError
from pinnochio.overlays import read_merged
from pinnochio.study.configuration import check_config
from pinnochio.study.schema import checked, read_schema
from pinnochio.study.study import Study
from pinnochio.training.network_archive import NETWORK, NetworkArchive, pack
from pinnochio.training.settings import PHASES


def read_config(paths: Sequence[str]) -> dict:
    """The first configuration with the values of the others over its own; InputError where it is none."""
    config = checked(read_merged(paths), read_schema(ROOT))
    check_config(config)
    return config


def pack_networks(config: Mapping, trained: str, methods: Sequence[str], out: str, made_on: str) -> NetworkArchive:
    """Write the archive of the methods, or of all whose networks are there for every fold, from
    {trained}/{fold}/{method}/."""
    study = Study.of(config)
    folds = study.folds.held_out
    whole = [
        name
        for name in study.methods.trained("by steps")
        if all(Path(trained, fold, name, NETWORK).is_file() for fold in folds)
    ]
    names = list(methods) or whole
    if not names:
        raise InputError("-", trained, "no method has a network of every fold", "train them first")
    settings = {
        name: {key: part for key, part in study.methods[name].settings.items() if key in ("network", *PHASES.values())}
        for name in names
    }
    learners = [source_file(study.methods[name].learner) for name in names]
    provenance = {"made_on": made_on, "code": code_hash(*learners)}
    return pack(trained=trained, out=out, methods=settings, held_out=folds, shown=config, provenance=provenance)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.ArgumentDefaultsHelpFormatter)
    parser.add_argument("--trained", default="results/folds", help="folder with {fold}/{method}/network.pt")
    parser.add_argument("--out", default="archives/networks", help="folder of the archive")
    parser.add_argument("--methods", nargs="*", default=[], help="methods; all that have every fold, if none is named")
    parser.add_argument("--config", nargs="+", default=["config/config.yaml"], help="what they were trained with")
    parser.add_argument("--made-on", default="", help="machine, date and versions, for the record")
    arguments = parser.parse_args()
    try:
        packed = pack_networks(
            config=read_config(arguments.config),
            trained=arguments.trained,
            methods=arguments.methods,
            out=arguments.out,
            made_on=arguments.made_on,
        )
    except InputError as error:
        sys.exit(str(error))
    print(f"{', '.join(packed.methods)}: {len(packed.files)} files, SHA-256 of the manifest {packed.sha256}")
