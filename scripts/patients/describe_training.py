"""Makes the ranges of anatomy and plans of the patients that the networks are trained on."""

from collections.abc import Sequence

from pinnochio.json_text import read_stored_json
from pinnochio.logs import attach_log
from pinnochio.model.patient import PatientModel
from pinnochio.patients.in_distribution import Norm, Ranges, anatomy_quantities, plan_quantities
from pinnochio.plans.plan import Plan


def describe_training(
    cases: Sequence[str], models: Sequence[str], plans: Sequence[str], qualities: Sequence[str], ranges: str
) -> None:
    """Write the ranges of the cases' anatomy (model and quality report) and of their own plans."""
    anatomies, movements, muscle, segments = [], [], set(), set()
    for case, model, plan, quality in zip(cases, models, plans, qualities, strict=True):
        patient = PatientModel.read(model)
        anatomies.append(anatomy_quantities(patient, read_stored_json(quality)))
        movements.append(plan_quantities(patient, Plan.read(plan, case)))
        muscle.add(patient.muscle)
        segments.update(patient.segments)
    norms = Ranges(
        anatomy=Norm.of(anatomies, from_rest=False),
        plan=Norm.of(movements, from_rest=True),
        muscle=sorted(muscle),
        segments=sorted(segments),
    )
    norms.write(ranges)


if __name__ == "__main__":
    attach_log(snakemake.log[0])
    describe_training(cases=snakemake.params.cases, **dict(snakemake.input.items()), ranges=snakemake.output.ranges)
