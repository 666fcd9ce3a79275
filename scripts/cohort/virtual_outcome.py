"""Makes what surgery did to a virtual patient: the scan of the new face, and the volumetric truth for evaluation."""

from collections.abc import Mapping

import trimesh

from pinnochio.files import replacing
from pinnochio.virtual.outcome import Operation, operate, photograph


def virtual_outcome(
    case: str,
    inputs: Mapping[str, str],
    outcome: dict,
    label_values: dict[str, int],
    segments: tuple[str, ...],
    seed: int,
    postop: str,
    truth: str,
    executed: str,
) -> None:
    """Operate with the effects of `outcome`, then scan the face.

    inputs: segmentation, plan, landmarks, anatomy, covariates; outcome: section `virtual.outcome` of the configuration.
    Files to write: postop (PLY, mm, in the scanner's frame), truth (HDF5: points, cells, displacement, the executed
    plan), executed (that plan as JSON). RuntimeError if no displacement is in equilibrium.
    """
    operation = Operation.read(
        case=case, inputs=inputs, labels=label_values, segments=segments, outcome=outcome, seed=seed
    )
    result = operate(operation, operation.settings.effects)
    seen = photograph(operation, result, operation.settings.effects)
    with replacing(postop) as temporary:
        trimesh.Trimesh(seen.points, seen.faces, process=False).export(temporary)
    result.write(truth)
    result.executed.write(executed)
