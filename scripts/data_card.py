"""Makes the data card of the virtual cohort and the checksums of its files."""

import hashlib
import json
from collections.abc import Mapping, Sequence
from pathlib import Path

from pinnochio.files import replacing
from pinnochio.logs import attach_log
from pinnochio.plans.plan import Plan
from pinnochio.virtual.card import data_card


def describe_cohort(
    cases: Sequence[str],
    files: Sequence[str],
    tables: Mapping[str, str],
    settings: Mapping,
    card: str,
    checksums: str,
) -> None:
    """Write the card (Markdown) and the checksums, in the form of sha256sum and relative to their own folder.

    files: every file of every case, in `{folder of the card}/{case}/`; tables: Markdown file by name; settings: seed,
    code, virtual and labels of :func:`pinnochio.virtual.card.data_card`.
    """
    folder = Path(card).parent
    anatomies = [json.loads((folder / case / "anatomy.json").read_text(encoding="utf-8")) for case in cases]
    plans = [Plan.read(folder / case / "plan.json", case) for case in cases]
    shown = {name: Path(path).read_text(encoding="utf-8") for name, path in tables.items()}
    with replacing(card) as temporary:
        temporary.write_text(data_card(anatomies, plans, tables=shown, **settings), encoding="utf-8")
    lines = []
    for path in sorted(Path(file).relative_to(folder).as_posix() for file in files):
        with open(folder / path, "rb") as file:
            lines.append(f"{hashlib.file_digest(file, 'sha256').hexdigest()}  {path}\n")
    with replacing(checksums) as temporary:
        temporary.write_text("".join(lines), encoding="utf-8")


if __name__ == "__main__":
    attach_log(snakemake.log[0])
    describe_cohort(
        cases=snakemake.params.cases,
        files=snakemake.input.files,
        tables=dict(zip(snakemake.params.tables, snakemake.input.tables, strict=True)),
        settings=snakemake.params.settings,
        card=snakemake.output.card,
        checksums=snakemake.output.checksums,
    )
