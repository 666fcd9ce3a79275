"""Makes the comparison of the virtual cohort, as it was made here, with its frozen checksums."""

import logging
import os
import platform
from collections.abc import Sequence
from pathlib import Path

import pandas as pd

from pinnochio.errors import InputError
from pinnochio.files import replacing
from pinnochio.logs import attach_log


def verify_cohort(made: Sequence[str], frozen: str, table: str) -> None:
    """Write which files are as they were frozen (CSV: file, same | differs | missing); InputError if any is not.

    made: files of checksums of this run; frozen: the checksums of the version, in the same form. Frozen files that
    this run did not make, such as outcomes that are not revealed, are left out.
    """
    own = {}
    for path in made:
        own |= read_sums(path)
    wanted = read_sums(frozen)
    rows = [
        {"file": name, "state": "same" if wanted.get(name) == value else "differs" if name in wanted else "missing"}
        for name, value in sorted(own.items())
    ]
    with replacing(table) as temporary:
        pd.DataFrame(rows).to_csv(temporary, index=False)
    other = [row["file"] for row in rows if row["state"] != "same"]
    logging.info("%d of %d files are as they were frozen", len(rows) - len(other), len(rows))
    if other:
        raise InputError(
            "-",
            frozen,
            f"{len(other)} of {len(rows)} files are not as they were frozen, the first is {other[0]}",
            "check out the version that froze them, with the default configuration and the locked environment; on "
            f"another processor than theirs (here {platform.machine()}) the last bits of the outcomes may differ",
        )


def read_sums(path: str | os.PathLike) -> dict[str, str]:
    """Checksum by file, of what sha256sum writes; lines that begin with # are comments."""
    lines = Path(path).read_text(encoding="utf-8").splitlines()
    pairs = (line.split("  ", 1) for line in lines if line and not line.startswith("#"))
    return {name: value for value, name in pairs}


if __name__ == "__main__":
    attach_log(snakemake.log[0])
    verify_cohort(made=snakemake.input.made, frozen=snakemake.input.frozen, table=snakemake.output.table)
