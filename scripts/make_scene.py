"""Makes the model that a patient's plan requires, and says what was decided and why."""

from pinnochio.importing.segmentation import read_labels
from pinnochio.logs import attach_log
from pinnochio.mechanics.settings import FemSettings
from pinnochio.model.patient import PatientModel
from pinnochio.model.surfaces import read_surface
from pinnochio.plans.plan import Plan
from pinnochio.reduction.decisions import decide, write_decisions
from pinnochio.reduction.models import reduced
from pinnochio.reduction.settings import SceneSettings


def make_scene(
    case: str,
    files: dict[str, str],
    interfaces: dict[str, float],
    fem: FemSettings,
    settings: SceneSettings,
    scene: str,
    model: str,
) -> None:
    """Decide for the patient's own plan, write the decisions (JSON) and the reduced model.

    files: model (the full one), labels, skin and plan; interfaces: section of the configuration.
    """
    patient, head = PatientModel.read(files["model"]), read_labels(files["labels"])
    plan = Plan.read(files["plan"], case)
    decisions, field, limit = decide(
        patient=patient,
        head=head,
        plan=plan,
        settings=settings,
        fem=fem,
        sliding_band=interfaces["sliding_band"],
        release=interfaces["release"],
    )
    made = reduced(
        patient=patient,
        head=head,
        skin=read_surface(files["skin"]),
        decisions=decisions,
        field=field,
        limit=limit,
        interfaces=interfaces,
    )
    made.write(model)
    write_decisions(case, {"own": decisions}, scene)


if __name__ == "__main__":
    attach_log(snakemake.log[0])
    make_scene(
        case=snakemake.wildcards.case,
        files=dict(snakemake.input.items()),
        interfaces=snakemake.params.interfaces,
        fem=FemSettings(**snakemake.params.fem),
        settings=SceneSettings(**snakemake.params.settings),
        scene=snakemake.output.scene,
        model=snakemake.output.model,
    )
