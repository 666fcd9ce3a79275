"""Makes of a patient's labels what no plan decides: mesh, model, lift, quality, lips; and samples to pretrain on."""

from collections.abc import Mapping
from pathlib import Path

from pinnochio.logs import attach_log
from pinnochio.mechanics.settings import FemSettings
from pinnochio.stages import Stages

MESH, LABEL = "scripts.patient.tetrahedralize:mesh_case", "scripts.patient.label_interfaces:label_case"
RECORD = ".model_patient.json"  # of the stages, beside the model


def model_patient(
    case: str,
    imported: Mapping[str, str],
    mesh_settings: Mapping[str, float],
    interfaces: Mapping[str, float],
    controls: int,
    fem: FemSettings,
    outputs: Mapping[str, str],
    lip_edge: float = 0.0,
    samples: Mapping[str, int] | None = None,
) -> None:
    """Run the stages one after another, as far as their outputs are named.

    imported: files labels, bone, skin, report, and plan for the samples; the settings are those of the stages, samples
    plans and seed; outputs: files mesh, and where they are wanted model, lift, quality, lips_mesh with lips_model, and
    fem_samples.
    """
    mesh, model = outputs["mesh"], outputs.get("model")
    read = {name: imported[name] for name in ("labels", "bone", "skin", "report")}
    with Stages(Path(mesh).with_name(RECORD)) as stages:
        stages(MESH, {"labels": imported["labels"]}, {"mesh": mesh}, mesh_settings)
        if model:
            stages(LABEL, {"mesh": mesh, **read}, {"model": model}, {"interfaces": interfaces})
        if "lift" in outputs:
            settings = {"controls": controls, "fem": fem}
            stages("scripts.patient.make_lift:write_lift", {"model": model}, {"lift": outputs["lift"]}, settings)
        if "quality" in outputs:
            files = {"model": model, "imported": imported["report"]}
            stages("scripts.patient.report_quality:report_quality", files, {"report": outputs["quality"]}, {})
        if "lips_mesh" in outputs:
            files = {"mesh": mesh, "labels": imported["labels"], "bone": imported["bone"]}
            settings = {"sliding_band": interfaces["sliding_band"], "lip_edge": lip_edge}
            stages("scripts.patient.model_lips:refine_lips", files, {"lips": outputs["lips_mesh"]}, settings)
            files = {"mesh": outputs["lips_mesh"], **read}
            stages(LABEL, files, {"model": outputs["lips_model"]}, {"interfaces": interfaces})
        if "fem_samples" in outputs:
            files, made = {"model": model, "plan": imported["plan"]}, {"fem_samples": outputs["fem_samples"]}
            stages("scripts.fem.simulate_fem:simulate_fem", files, made, {"case": case, "settings": fem, **samples})


if __name__ == "__main__":
    attach_log(snakemake.log[0])
    params = snakemake.params
    model_patient(
        case=snakemake.wildcards.case,
        imported=dict(snakemake.input.items()),
        mesh_settings={"nodes": params.nodes, "minimum_dihedral": params.minimum_dihedral},
        interfaces=params.interfaces,
        controls=params.controls,
        fem=FemSettings(**params.fem),
        outputs=dict(snakemake.output.items()),
        lip_edge=params.lip_edge,
        samples={"plans": params.plans, "seed": params.seed},
    )
