"""Makes the page to look at a new patient's prediction."""

from pinnochio.json_text import read_own_json
from pinnochio.logs import attach_log
from pinnochio.model.patient import PatientModel
from pinnochio.patients.page import write_page
from pinnochio.patients.result import read_result
from pinnochio.plans.plan import Plan


def show_prediction(case: str, model: str, plan: str, result: str, certificate: str, page: str) -> None:
    """Write pictures, maps and the certificate in words as one HTML file."""
    patient = PatientModel.read(model)
    prediction = read_result(result, case, patient)
    write_page(
        patient=patient,
        plan=Plan.read(plan, case),
        displacement=prediction.displacement,
        half_width=prediction.half_width,
        certificate=read_own_json(certificate),
        path=page,
    )


if __name__ == "__main__":
    attach_log(snakemake.log[0])
    show_prediction(
        case=snakemake.wildcards.case,
        model=snakemake.input.model,
        plan=snakemake.input.plan,
        result=snakemake.input.result,
        certificate=snakemake.input.certificate,
        page=snakemake.output.page,
    )
