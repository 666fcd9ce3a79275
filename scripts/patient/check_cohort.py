"""Makes one table of the imported patients, the sign that every file was read and checked."""

import csv
from collections.abc import Sequence

from pinnochio.files import replacing
from pinnochio.gathered import gathered
from pinnochio.importing.repair import repaired_voxels
from pinnochio.json_text import read_stored_json
from pinnochio.logs import attach_log


def check_cohort(cases: Sequence[str], reports: Sequence[str], table: str) -> None:
    """Write one row per case: voxel spacing (mm), muscle layer, repaired voxels, volume of each structure (cm3)."""
    rows = []
    for case, path in zip(cases, reports, strict=True):
        report = read_stored_json(path)
        volumes = {f"{name}_cm3": volume for name, volume in report["volume_cm3"].items()}
        row = {"case": case, "spacing_mm": "x".join(f"{s:g}" for s in report["spacing_mm"]), "muscle": report["muscle"]}
        rows.append(row | {"repaired_voxels": repaired_voxels(report["repairs"])} | volumes)
    columns = list(dict.fromkeys(name for row in rows for name in row))
    with replacing(table) as temporary, open(temporary, "w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, columns, lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)


if __name__ == "__main__":
    attach_log(snakemake.log[0])
    files, cases = snakemake.input, snakemake.params.cases
    reports = files.get("imports") or gathered(files.folders, cases, "import.json")
    check_cohort(cases=cases, reports=reports, table=snakemake.output.table)
