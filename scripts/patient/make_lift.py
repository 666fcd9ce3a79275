"""Makes the lift of a patient: how any motion of the bone spreads through its tissue, to first order."""

import logging

from pinnochio.logs import attach_log
from pinnochio.mechanics.lift import make_lift
from pinnochio.mechanics.settings import FemSettings
from pinnochio.model.patient import PatientModel


def write_lift(model: str, controls: int, fem: FemSettings, lift: str) -> None:
    """Write the lift of the patient model; controls: its control points."""
    patient = PatientModel.read(model)
    made = make_lift(model=patient, material=fem.material(patient.tissue), controls=controls, volumetric=fem.volumetric)
    logging.info("%d motions, %d departures, %.1f s", len(made.motions), len(made.departures), made.seconds)
    made.write(lift)


if __name__ == "__main__":
    attach_log(snakemake.log[0])
    write_lift(
        model=snakemake.input.model,
        controls=snakemake.params.controls,
        fem=FemSettings(**snakemake.params.fem),
        lift=snakemake.output.lift,
    )
