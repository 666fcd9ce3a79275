"""Makes the page on which all plans of a new patient lie side by side."""

from collections.abc import Mapping, Sequence
from pathlib import Path

from pinnochio.columns import read_table
from pinnochio.json_text import read_stored_json
from pinnochio.logs import attach_log
from pinnochio.model.patient import PatientModel
from pinnochio.patients.face_measures import TABLE
from pinnochio.patients.result import read_result
from pinnochio.plans.plan import Plan
from pinnochio.report.plans import ComparedPlan, write_plans


def show_plans(case: str, method: str, model: str, files: Mapping[str, Sequence[str]], page: str) -> None:
    """Write the page. files: of every plan, in one order, its `plans`, `results`, `certificates` and `measures`."""
    patient, compared, level = PatientModel.read(model), [], None
    columns = (files[name] for name in ("plans", "results", "certificates", "measures"))
    for plan, result, certified, measures in zip(*columns, strict=True):
        name, certificate = Path(plan).parent.name, read_stored_json(certified)
        level = certificate["interval"]["level"] if certificate["interval"] else None
        compared.append(
            ComparedPlan(
                name=name,
                plan=Plan.read(plan, case),
                page=f"{name}/{method}/index.html",
                verdict=certificate["verdict"]["grade"],
                displacement=read_result(result, case, patient).displacement,
                measures=read_table(measures, TABLE),
            )
        )
    write_plans(case=case, method=method, patient=patient, plans=compared, level=level, path=page)


if __name__ == "__main__":
    attach_log(snakemake.log[0])
    show_plans(
        case=snakemake.wildcards.case,
        method=snakemake.wildcards.method,
        model=snakemake.input.model,
        files=dict(snakemake.input.items()),
        page=snakemake.output.page,
    )
