"""Makes what surgery did to a virtual patient: the scan of the new face, and the volumetric truth for evaluation."""

import trimesh

from pinnochio.files import replacing
from pinnochio.logs import attach_log
from pinnochio.mechanics.settings import FemSettings
from pinnochio.virtual.ground_truth import resolve
from pinnochio.virtual.outcome import Operation, operate, photograph


def virtual_outcome(
    case: str,
    inputs: dict[str, str],
    reality: str | dict,
    mesh: dict[str, float],
    interfaces: dict[str, float],
    fem: FemSettings,
    label_values: dict[str, int],
    segments: tuple[str, ...],
    seed: int,
    outputs: dict[str, str],
) -> None:
    """Operate with the effects of `reality`, then scan.

    inputs: segmentation, plan, landmarks; reality, mesh, interfaces: sections of the configuration. outputs: postop
    (PLY, mm, in the scanner's frame), truth (HDF5: points, cells, displacement, the executed plan). RuntimeError if no
    outcome is found.
    """
    operation = Operation.read(case, inputs, label_values, segments, mesh, interfaces, fem, seed)
    effects = resolve(reality)
    outcome = operate(operation, effects)
    seen = photograph(operation, outcome, effects)
    with replacing(outputs["postop"]) as temporary:
        trimesh.Trimesh(seen.points, seen.faces, process=False).export(temporary)
    outcome.write(outputs["truth"])


if __name__ == "__main__":
    attach_log(snakemake.log[0])
    virtual_outcome(
        case=snakemake.wildcards.case,
        inputs=dict(snakemake.input.items()),
        reality=snakemake.params.reality,
        mesh=snakemake.params.mesh,
        interfaces=snakemake.params.interfaces,
        fem=FemSettings(**snakemake.params.fem),
        label_values=snakemake.params.labels,
        segments=tuple(snakemake.params.segments),
        seed=snakemake.params.seed,
        outputs=dict(snakemake.output.items()),
    )
