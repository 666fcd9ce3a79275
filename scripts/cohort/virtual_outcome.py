"""Makes what surgery did to a virtual patient: the scan of the new face, and the volumetric truth for evaluation."""

import trimesh

from pinnochio.files import replacing
from pinnochio.logs import attach_log
from pinnochio.virtual.outcome import Operation, operate, photograph


def virtual_outcome(
    case: str,
    inputs: dict[str, str],
    outcome: dict,
    label_values: dict[str, int],
    segments: tuple[str, ...],
    seed: int,
    outputs: dict[str, str],
) -> None:
    """Operate with the effects of `outcome`, then scan.

    inputs: segmentation, plan, landmarks, anatomy, covariates; outcome: section `virtual.outcome` of the configuration.
    outputs: postop (PLY, mm, in the scanner's frame), truth (HDF5: points, cells, displacement, the executed plan),
    executed (that plan as JSON). RuntimeError if no displacement is in equilibrium.
    """
    operation = Operation.read(
        case=case, inputs=inputs, labels=label_values, segments=segments, outcome=outcome, seed=seed
    )
    result = operate(operation, operation.settings.effects)
    seen = photograph(operation, result, operation.settings.effects)
    with replacing(outputs["postop"]) as temporary:
        trimesh.Trimesh(seen.points, seen.faces, process=False).export(temporary)
    result.write(outputs["truth"])
    result.executed.write(outputs["executed"])


if __name__ == "__main__":
    attach_log(snakemake.log[0])
    virtual_outcome(
        case=snakemake.wildcards.case,
        inputs=dict(snakemake.input.items()),
        outcome=snakemake.params.outcome,
        label_values=snakemake.params.labels,
        segments=tuple(snakemake.params.segments),
        seed=snakemake.params.seed,
        outputs=dict(snakemake.output.items()),
    )
