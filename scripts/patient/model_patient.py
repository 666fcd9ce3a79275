"""Makes of a patient's labels all that no plan decides: mesh, model, lift, quality."""

from collections.abc import Mapping
from pathlib import Path

from pinnochio.logs import attach_log
from pinnochio.mechanics.settings import FemSettings
from pinnochio.stages import Stages
from scripts.patient.label_interfaces import label_case
from scripts.patient.make_lift import write_lift
from scripts.patient.report_quality import report_quality
from scripts.patient.tetrahedralize import mesh_case

RECORD = ".model_patient.json"  # of the stages, beside the model


def model_patient(
    imported: Mapping[str, str],
    mesh_settings: Mapping[str, float],
    interfaces: Mapping[str, float],
    controls: int,
    fem: FemSettings,
    outputs: Mapping[str, str],
) -> None:
    """Run the stages one after another.

    imported: files labels, bone, skin, report; the settings are those of the stages; outputs: files mesh, model, and
    where they are wanted lift and quality.
    """
    mesh, model = outputs["mesh"], outputs["model"]
    stages = Stages(Path(model).with_name(RECORD))
    stages(mesh_case, {"labels": imported["labels"]}, {"mesh": mesh}, mesh_settings)
    stages(label_case, {"mesh": mesh, **imported}, {"model": model}, {"interfaces": interfaces})
    if "lift" in outputs:
        settings = {"controls": controls, "fem": fem}
        stages(write_lift, {"model": model}, {"lift": outputs["lift"]}, settings)
    if "quality" in outputs:
        files = {"model": model, "imported": imported["report"]}
        stages(report_quality, files, {"report": outputs["quality"]}, {})


if __name__ == "__main__":
    attach_log(snakemake.log[0])
    params = snakemake.params
    model_patient(
        imported={name: snakemake.input[name] for name in ("labels", "bone", "skin", "report")},
        mesh_settings={"nodes": params.nodes, "minimum_dihedral": params.minimum_dihedral},
        interfaces=params.interfaces,
        controls=params.controls,
        fem=FemSettings(**params.fem),
        outputs=dict(snakemake.output.items()),
    )
