"""Makes the quality report of one patient's model."""

import json

from pinnochio.files import replacing
from pinnochio.json_text import read_stored_json
from pinnochio.logs import attach_log
from pinnochio.metrics.model_quality import quality
from pinnochio.model.patient import PatientModel


def report_quality(model: str, imported: str, report: str) -> None:
    """Write volumes, thickness, contact areas, mesh quality and repairs; imported is the import's report."""
    measured = quality(PatientModel.read(model), read_stored_json(imported))
    with replacing(report) as temporary:
        temporary.write_text(json.dumps(measured, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    attach_log(snakemake.log[0])
    from scripts.patient.show_quality import show_quality  # pictures take seconds that a report alone is spared

    report_quality(
        model=snakemake.input.model,
        imported=snakemake.input.imported,
        report=snakemake.output.report,
    )
    show_quality(case=snakemake.wildcards.case, model=snakemake.input.model, picture=snakemake.output.picture)
