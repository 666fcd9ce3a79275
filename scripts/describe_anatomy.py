"""Makes the tables of the virtual cohort's anatomy: soft-tissue thickness beside the literature, and every patient."""

import json
from collections.abc import Sequence
from pathlib import Path

from pinnochio.logs import attach_log
from pinnochio.virtual.description import anatomy_table, write_anatomy
from pinnochio.virtual.thickness import tabulate, write_thickness


def describe_anatomy(anatomies: Sequence[str], thickness: str, patients: str) -> None:
    """Write both tables (CSV and twins) of the patients' anatomy files (JSON)."""
    found = [json.loads(Path(path).read_text(encoding="utf-8")) for path in anatomies]
    write_thickness(tabulate([patient["thickness"] for patient in found]), thickness)
    write_anatomy(anatomy_table(found), patients)


if __name__ == "__main__":
    attach_log(snakemake.log[0])
    describe_anatomy(
        anatomies=snakemake.input.anatomies, thickness=snakemake.output.thickness, patients=snakemake.output.patients
    )
