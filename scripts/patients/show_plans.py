"""Makes the page on which all plans of a new patient lie side by side."""

from collections.abc import Mapping
from pathlib import Path

from pinnochio.columns import read_table
from pinnochio.json_text import read_stored_json
from pinnochio.logs import attach_log
from pinnochio.model.patient import PatientModel
from pinnochio.patients.face_measures import TABLE
from pinnochio.patients.result import read_result
from pinnochio.plans.plan import Plan
from pinnochio.report.plans import ComparedPlan, write_plans


def show_plans(case: str, method: str, model: str, files: Mapping[str, Mapping[str, str]], page: str) -> None:
    """Write the page. files: by the plan's name its `plan`, `result`, `certificate` and `measures`."""
    patient, plans, level = PatientModel.read(model), [], None
    for name, paths in files.items():
        certificate = read_stored_json(paths["certificate"])
        level = certificate["interval"]["level"] if certificate["interval"] else None
        plans.append(
            ComparedPlan(
                name=name,
                plan=Plan.read(paths["plan"], case),
                page=f"{name}/{method}/index.html",
                verdict=certificate["verdict"]["grade"],
                displacement=read_result(paths["result"], case, patient).displacement,
                measures=read_table(paths["measures"], TABLE),
            )
        )
    write_plans(case=case, method=method, patient=patient, plans=plans, level=level, path=page)


if __name__ == "__main__":
    attach_log(snakemake.log[0])
    inputs = ("plans", "results", "certificates", "measures")
    columns = zip(*(snakemake.input[name] for name in inputs), strict=True)
    names = [Path(plan).parent.name for plan in snakemake.input.plans]
    show_plans(
        case=snakemake.wildcards.case,
        method=snakemake.wildcards.method,
        model=snakemake.input.model,
        files={
            name: dict(zip(("plan", "result", "certificate", "measures"), paths, strict=True))
            for name, paths in zip(names, columns, strict=True)
        },
        page=snakemake.output.page,
    )
