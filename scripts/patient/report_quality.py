"""Makes the quality report of one patient's model."""

import json

from pinnochio.files import replacing
from pinnochio.json_text import read_stored_json
from pinnochio.metrics.model_quality import quality
from pinnochio.model.patient import PatientModel


def report_quality(model: str, imported: str, report: str) -> None:
    """Write volumes, thickness, contact areas, mesh quality and repairs; imported is the import's report."""
    measured = quality(PatientModel.read(model), read_stored_json(imported))
    with replacing(report) as temporary:
        temporary.write_text(json.dumps(measured, indent=1) + "\n", encoding="utf-8")
