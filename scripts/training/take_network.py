"""Makes files of a fold's trained network of those that an archive holds."""

from collections.abc import Sequence

from pinnochio.logs import attach_log
from pinnochio.training.network_archive import take


def take_network(archive: str, names: Sequence[str], outputs: Sequence[str]) -> None:
    """Copy the files of these names from the archive's folder, each if its SHA-256 is that of the manifest."""
    take(folder=archive, names=names, outputs=outputs)


if __name__ == "__main__":
    attach_log(snakemake.log[0])
    take_network(archive=snakemake.params.archive, names=snakemake.params.names, outputs=list(snakemake.output))
