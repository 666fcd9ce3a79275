"""Makes a virtual patient of its seed: segmentation, the plan that treats its deformity, landmarks."""

import json

import numpy as np

from pinnochio.anatomy.labels import AIR, internal_codes
from pinnochio.anatomy.segmentation import write_segmentation
from pinnochio.files import replacing
from pinnochio.logs import attach_log
from pinnochio.seeds import generator
from pinnochio.virtual.head import build_head
from pinnochio.virtual.parameters import DEFORMITIES, sample_parameters
from pinnochio.virtual.treatment import treatment_plan


def virtual_patient(
    case: str, number: int, seed: int, spacing: float, label_values: dict[str, int], outputs: dict[str, str]
) -> None:
    """Sample the anatomy and the plan, and write them as a clinic would deliver them.

    number picks the deformity class in turn; spacing is the voxel edge (mm); label_values maps each structure to its
    voxel value. The landmarks (mm, LPS) serve the simulated outcome alone. outputs: segmentation, plan, landmarks.
    """
    rng = generator(seed, "virtual_patient", case)
    head = build_head(sample_parameters(rng, DEFORMITIES[number % len(DEFORMITIES)]), spacing)
    values = np.full(256, AIR, np.uint16)
    for name, code in internal_codes(head.segments).items():
        values[code] = label_values[name]
    write_segmentation(values[head.labels], head.spacing, head.origin, outputs["segmentation"])
    treatment_plan(head, rng, case).write(outputs["plan"])
    landmarks = {name: np.round(place, 3).tolist() for name, place in head.landmarks.items()}
    with replacing(outputs["landmarks"]) as temporary:
        temporary.write_text(json.dumps(landmarks, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    attach_log(snakemake.log[0])
    virtual_patient(
        snakemake.wildcards.case,
        snakemake.params.number,
        snakemake.params.seed,
        snakemake.params.spacing,
        snakemake.params.labels,
        dict(snakemake.output.items()),
    )
