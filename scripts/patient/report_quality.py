"""Makes the quality report of one patient's model."""

from pinnochio.json_text import read_stored_json, write_json
from pinnochio.metrics.model_quality import quality
from pinnochio.model.patient import PatientModel


def report_quality(model: str, imported: str, report: str) -> None:
    """Write volumes, thickness, contact areas, mesh quality and repairs; imported is the import's report."""
    measured = quality(PatientModel.read(model), read_stored_json(imported))
    write_json(report, measured)
