"""Makes the finite-element fields that the networks are pretrained on: the patient's own plan and sampled ones."""

import logging

from pinnochio.hdf5 import writing
from pinnochio.mechanics.settings import FemSettings
from pinnochio.mechanics.simulation import Simulator
from pinnochio.model.patient import PatientModel
from pinnochio.plans.plan import Plan
from pinnochio.plans.sampling import sample_plan
from pinnochio.seeds import generator


def simulate_fem(
    case: str, model: str, plan: str, plans: int, settings: FemSettings, seed: int, fem_samples: str
) -> None:
    """Solve `plans` plans with sliding interfaces; write the fields in groups plan_0, plan_1, ...

    plan_0 is the patient's own plan if it converges; the others are sampled from (seed, stage, case). A plan that
    does not converge is replaced by a newly sampled one, at most `plans` times; RuntimeError if too few converge.
    """
    patient = PatientModel.read(model)
    fields, attempts = [], 0
    sampled = {
        "rng": generator(seed, "simulate_fem", case),
        "case": case,
        "segments": patient.segments,
        "points": patient.bone_points,
        "segment": patient.bone_segment,
    }
    with Simulator(patient, settings) as simulator:
        while len(fields) < plans and attempts < 2 * plans:
            count = min(plans - len(fields), 2 * plans - attempts)
            tried = [sample_plan(**sampled) if attempts + i else Plan.read(plan, case) for i in range(count)]
            for current, result in zip(tried, simulator.solve(tried), strict=True):
                way = "kept factors" if result.kept else "Newton's method"
                logging.info("plan %d by %s: %s, %.1f s", attempts, way, result.reason, result.seconds)
                attempts += 1
                if result.converged:
                    fields.append((current, result))
    if len(fields) < plans:
        raise RuntimeError(f"case {case!r}: only {len(fields)} of {2 * plans} plans converged; see the log")
    with writing(fem_samples) as file:
        for number, (current, result) in enumerate(fields):
            group = file.create_group(f"plan_{number}")
            group.create_dataset("displacement", data=result.displacement, track_times=False)
            group.attrs["plan"] = current.to_json()
            group.attrs["min_jacobian"] = result.min_jacobian
