"""Makes what surgery did to a virtual patient: scans of the new face and bones, the volumetric truth for evaluation."""

from collections.abc import Mapping
from pathlib import Path

from pinnochio.logs import attach_log
from pinnochio.stages import Stages
from scripts.cohort.virtual_outcome import virtual_outcome
from scripts.cohort.virtual_postop_bones import virtual_postop_bones


def operate_and_scan(
    inputs: Mapping[str, str],
    settings: Mapping[str, object],
    outcome: dict,
    artefacts: float,
    outputs: Mapping[str, str],
) -> None:
    """The outcome, then the bones' scan; another scan operates nothing anew.

    inputs, outcome: as of :func:`virtual_outcome`; settings: case, label_values, segments and seed of both; artefacts:
    of the bones' scan; outputs: files postop, truth, executed, bones.
    """
    with Stages(Path(outputs["truth"]).with_name(".virtual_outcome.json")) as stages:
        face = {name: outputs[name] for name in ("postop", "truth", "executed")}
        stages(virtual_outcome, {"inputs": inputs}, face, {**settings, "outcome": outcome})
        read = {"segmentation": inputs["segmentation"], "executed": outputs["executed"]}
        stages(virtual_postop_bones, read, {"bones": outputs["bones"]}, {**settings, "artefacts": artefacts})


if __name__ == "__main__":
    attach_log(snakemake.log[0])
    params = snakemake.params
    about = {"case": snakemake.wildcards.case, "label_values": params.labels, "segments": tuple(params.segments)}
    operate_and_scan(
        inputs=dict(snakemake.input.items()),
        settings=about | {"seed": params.seed},
        outcome=params.outcome,
        artefacts=params.artefacts,
        outputs=dict(snakemake.output.items()),
    )
