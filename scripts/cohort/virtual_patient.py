"""Makes a virtual patient of its seed: segmentation, the plan that treats its deformity, and what is known of it."""

import numpy as np

from pinnochio.errors import InputError
from pinnochio.importing.segmentation import write_segmentation
from pinnochio.json_text import read_stored_json, write_json
from pinnochio.logs import attach_log
from pinnochio.model.labels import AIR, internal_codes
from pinnochio.seeds import generator
from pinnochio.virtual.covariates import sample_covariates
from pinnochio.virtual.description import describe
from pinnochio.virtual.head import build_head
from pinnochio.virtual.procedures import DEFORMITIES, Procedure
from pinnochio.virtual.scanned import sample_patient
from pinnochio.virtual.treatment import treatment_plan


def virtual_patient(
    case: str,
    number: int,
    seed: int,
    spacing: float,
    label_values: dict[str, int],
    procedure: Procedure,
    outputs: dict[str, str],
) -> None:
    """Sample the anatomy and the plan, and write them as a clinic would deliver them.

    number picks the deformity class in turn; procedure is the operation; spacing is the voxel edge (mm); label_values
    maps each structure to its voxel value. The landmarks (mm, LPS) and the anatomy serve the simulated outcome and the
    tables alone. outputs: segmentation, plan, landmarks, anatomy. Raises InputError for label values that it cannot
    write.
    """
    rng = generator(seed, "virtual_patient", case)
    parameters = sample_patient(rng, DEFORMITIES[number % len(DEFORMITIES)])
    head = build_head(parameters=parameters, spacing=spacing, procedure=procedure)
    try:
        values = np.full(256, AIR, np.uint16)
        for name, code in internal_codes(head.segments).items():
            values[code] = label_values[name]
    except ValueError as error:
        remedy = "give each structure of a virtual patient a whole number in 'labels'"
        raise InputError(case, "configuration", str(error), remedy) from error
    plan = treatment_plan(head, rng, case)
    write_segmentation(values[head.labels], head.spacing, head.origin, outputs["segmentation"])
    plan.write(outputs["plan"])
    landmarks = {name: np.round(place, 3).tolist() for name, place in head.landmarks.items()}
    for name, content in (("landmarks", landmarks), ("anatomy", {"case": case} | describe(head, plan))):
        write_json(outputs[name], content, allow_nan=False)


def draw_covariates(case: str, anatomy: str, reality: str, seed: int, covariates: str) -> None:
    """Draw what a clinic would know beside plan and images; anatomy: JSON file of the patient; reality: of the outcome;
    covariates: JSON file to write."""
    rng = generator(seed, "sample_covariates", case)
    sample_covariates(read_stored_json(anatomy), reality, rng).write(covariates)


if __name__ == "__main__":
    attach_log(snakemake.log[0])
    virtual_patient(
        case=snakemake.wildcards.case,
        **{name: snakemake.params[name] for name in ("number", "seed", "spacing")},
        label_values=snakemake.params.labels,
        procedure=Procedure(**snakemake.params.procedure),
        outputs=dict(snakemake.output.items()),
    )
    draw_covariates(
        case=snakemake.wildcards.case,
        anatomy=snakemake.output.anatomy,
        reality=snakemake.params.reality,
        seed=snakemake.params.seed,
        covariates=snakemake.output.covariates,
    )
