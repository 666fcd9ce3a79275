"""Makes the finite-element field of a patient's own plan, its summary and a picture."""

import meshio
import numpy as np

from pinnochio.figures.patient import field_picture
from pinnochio.files import replacing
from pinnochio.json_text import write_json
from pinnochio.logs import attach_log
from pinnochio.mechanics.elements.tetrahedra import jacobians
from pinnochio.mechanics.settings import FemSettings
from pinnochio.mechanics.simulation import simulate
from pinnochio.model.patient import PatientModel
from pinnochio.plans.plan import Plan


def solve_plan(
    case: str, model: str, plan: str, arm: str, settings: FemSettings, field: str, summary: str, picture: str
) -> None:
    """Solve and write the deformed field (VTU, mm), what the solver says (JSON) and before/after views (PNG).

    Raises RuntimeError with the solver's reason if it does not converge.
    """
    patient, motions = PatientModel.read(model), Plan.read(plan, case)
    (result,) = simulate(patient, [motions], settings, arm=arm)
    if not result.converged:
        raise RuntimeError(f"case {case!r}: the solver stopped: {result.reason}")
    ratios = jacobians(patient.points, patient.cells, result.displacement)
    with replacing(field) as temporary:
        meshio.Mesh(
            patient.points,
            [("tetra", patient.cells)],
            point_data={"displacement": result.displacement, "node_type": patient.node_type},
            cell_data={"tissue": [patient.tissue], "jacobian": [ratios]},
        ).write(temporary)
    field_picture(patient=patient, plan=motions, displacement=result.displacement, path=picture)
    report = {
        "case": case,
        "arm": arm,
        "nodes": len(patient.points),
        "converged": result.converged,
        "reason": result.reason,
        "relative_residual": result.residual,
        "min_jacobian": float(ratios.min()),
        "inverted": int(np.sum(ratios <= 0)),
        "sliding_violation_mm": result.violation,
        "contact_penetration_mm": result.penetration,
        "contact_gap_mm": result.gap,
        "largest_displacement_mm": float(np.linalg.norm(result.displacement, axis=1).max()),
        "increments": result.increments,
        "iterations": result.iterations,
    }
    write_json(summary, report)


if __name__ == "__main__":
    attach_log(snakemake.log[0])
    solve_plan(
        case=snakemake.wildcards.case,
        **dict(snakemake.input.items()),
        arm=snakemake.wildcards.arm,
        settings=FemSettings(**snakemake.params.fem),
        **dict(snakemake.output.items()),
    )
