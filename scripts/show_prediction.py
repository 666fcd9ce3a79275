"""Makes the page to look at a new patient's prediction."""

import json
from pathlib import Path

from pinnochio.anatomy.model import PatientModel
from pinnochio.anatomy.plan import Plan
from pinnochio.logs import attach_log
from pinnochio.patients.page import write_page
from pinnochio.patients.result import read_result


def show_prediction(case: str, model: str, plan: str, result: str, certificate: str, page: str) -> None:
    """Write pictures, maps and the certificate in words as one HTML file."""
    patient, said = PatientModel.read(model), json.loads(Path(certificate).read_text(encoding="utf-8"))
    found = read_result(result, case, patient)
    write_page(patient, Plan.read(plan, case), found.displacement, found.half_width, said, page)


if __name__ == "__main__":
    attach_log(snakemake.log[0])
    show_prediction(
        snakemake.wildcards.case,
        snakemake.input.model,
        snakemake.input.plan,
        snakemake.input.result,
        snakemake.input.certificate,
        snakemake.output.page,
    )
