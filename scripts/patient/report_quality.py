"""Makes the quality report of one patient's model, as JSON and as a picture."""

import json

from pinnochio.figures.quality import quality_picture
from pinnochio.files import replacing
from pinnochio.json_text import read_stored_json
from pinnochio.logs import attach_log
from pinnochio.metrics.model_quality import quality
from pinnochio.model.patient import PatientModel


def report_quality(model: str, imported: str, report: str, picture: str) -> None:
    """Write volumes, thickness, contact areas, mesh quality and repairs; imported is the import's report."""
    patient = PatientModel.read(model)
    measured = quality(patient, read_stored_json(imported))
    with replacing(report) as temporary:
        temporary.write_text(json.dumps(measured, indent=1) + "\n", encoding="utf-8")
    quality_picture(patient, measured["case"], picture)


if __name__ == "__main__":
    attach_log(snakemake.log[0])
    report_quality(
        model=snakemake.input.model,
        imported=snakemake.input.imported,
        report=snakemake.output.report,
        picture=snakemake.output.picture,
    )
