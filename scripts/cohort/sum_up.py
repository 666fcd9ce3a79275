"""Makes the checksums of files of the virtual cohort."""

import hashlib
from collections.abc import Sequence
from pathlib import Path

from pinnochio.files import replacing
from pinnochio.logs import attach_log


def sum_up(files: Sequence[str], checksums: str) -> None:
    """Write the SHA-256 of the files in the form of sha256sum, sorted, relative to the folder of the checksums."""
    folder, lines = Path(checksums).parent, []
    for path in sorted(Path(file).relative_to(folder).as_posix() for file in files):
        with open(folder / path, "rb") as file:
            lines.append(f"{hashlib.file_digest(file, 'sha256').hexdigest()}  {path}\n")
    with replacing(checksums) as temporary:
        temporary.write_text("".join(lines), encoding="utf-8")


if __name__ == "__main__":
    attach_log(snakemake.log[0])
    sum_up(files=snakemake.input.files, checksums=snakemake.output.checksums)
