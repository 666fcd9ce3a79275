"""Makes the comparison of the virtual cohort, as it was made here, with its frozen checksums."""

import logging
import os
import platform
import re
from collections.abc import Sequence

import pandas as pd

from pinnochio.errors import REMEDY, InputError
from pinnochio.files import replacing
from pinnochio.json_text import read_stored_text
from pinnochio.logs import attach_log


def verify_cohort(made: Sequence[str], frozen: str, table: str) -> None:
    """Write which files are as they were frozen (CSV: file, same | differs | missing); InputError if any is not.

    made: files of checksums of this run; frozen: the checksums of the version, in the same form. Frozen files that
    this run did not make, such as outcomes that are not revealed, are left out.
    """
    made_sums = {}
    for path in made:
        made_sums |= read_sums(path)
    wanted = read_sums(frozen)
    rows = [
        {"file": name, "state": "same" if wanted.get(name) == value else "differs" if name in wanted else "missing"}
        for name, value in sorted(made_sums.items())
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
    lines = [line for line in read_stored_text(path).splitlines() if line and not line.startswith("#")]
    if wrong := [line for line in lines if not re.fullmatch("[0-9a-f]{64}  .+", line)]:
        raise InputError("-", path, f"{wrong[0][:80]!r} is no line of sha256sum", REMEDY)
    return {name: value for value, name in (line.split("  ", 1) for line in lines)}


if __name__ == "__main__":
    attach_log(snakemake.log[0])
    verify_cohort(made=snakemake.input.made, frozen=snakemake.input.frozen, table=snakemake.output.table)
