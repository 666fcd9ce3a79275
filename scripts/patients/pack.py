"""Makes the archive of trained models: networks, calibrations, training ranges and a manifest."""

import shutil
from collections.abc import Mapping, Sequence
from pathlib import Path

import pandas as pd

from pinnochio.columns import read_csv
from pinnochio.files import replacing
from pinnochio.logs import attach_log
from pinnochio.patients.certificate import USUAL
from pinnochio.patients.model_archive import RANGES, Archive, calibration_file, network_file


def pack(
    about: Mapping,
    methods: Mapping[str, Mapping],
    networks: Mapping[tuple[str, str], str],
    metrics: Mapping[tuple[str, str], str],
    calibrations: Mapping[str, str],
    ranges: str,
    archive: str,
) -> None:
    """Copy the files into the folder `archive` and write its manifest last.

    about: the fields of Archive but `methods`; methods: settings of each; networks and metrics by (method, fold),
    calibrations by method, which may be more. The metrics give what is usual on held-out patients.
    """
    copies = {network_file(*key): path for key, path in networks.items()}
    copies |= {calibration_file(method): path for method, path in calibrations.items()} | {RANGES: ranges}
    for name, path in copies.items():
        with replacing(Path(archive) / name) as temporary:
            shutil.copyfile(path, temporary)
    described = {}
    for method, settings in methods.items():
        files = [path for (values, _), path in metrics.items() if values == method]
        held_out = pd.concat(read_csv(path, usecols=USUAL, dtype=float) for path in files)
        described[method] = dict(settings) | {"usual": usual(held_out)}
    Archive(**about, methods=described).write(archive)


def usual(held_out: pd.DataFrame) -> dict[str, Sequence[float]]:
    """Smallest, middle and largest value of each metric of USUAL that some row has."""
    known = {name: held_out[name].dropna() for name in USUAL}
    return {
        name: [float(x) for x in (values.min(), values.median(), values.max())]
        for name, values in known.items()
        if len(values)
    }


if __name__ == "__main__":
    attach_log(snakemake.log[0])
    keys = [(method, fold) for method in snakemake.params.methods for fold in snakemake.params.about["folds"]]
    pack(
        about=snakemake.params.about,
        methods=snakemake.params.methods,
        networks=dict(zip(keys, snakemake.input.networks, strict=True)),
        metrics=dict(zip(keys, snakemake.input.metrics, strict=True)),
        calibrations=dict(zip(snakemake.params.calibrated, snakemake.input.calibrations, strict=True)),
        ranges=snakemake.input.ranges,
        archive=str(Path(snakemake.output.manifest).parent),
    )
