"""Makes the quality report of one patient's model, as JSON and as a picture."""

import json
from pathlib import Path

from pinnochio.anatomy.model import PatientModel
from pinnochio.evaluation.quality import quality
from pinnochio.evaluation.quality_picture import quality_picture
from pinnochio.files import replacing
from pinnochio.logs import attach_log


def report_quality(model: str, imported: str, report: str, picture: str) -> None:
    """Write volumes, thickness, contact areas, mesh quality and repairs; imported is the import's report."""
    patient = PatientModel.read(model)
    found = quality(patient, json.loads(Path(imported).read_text(encoding="utf-8")))
    with replacing(report) as temporary:
        temporary.write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")
    quality_picture(patient, found["case"], picture)


if __name__ == "__main__":
    attach_log(snakemake.log[0])
    report_quality(
        snakemake.input.model,
        snakemake.input.imported,
        snakemake.output.report,
        snakemake.output.picture,
    )
