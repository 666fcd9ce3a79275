"""Makes the model that a patient's plan requires, and says what was decided and why."""

from pinnochio.anatomy.model import PatientModel
from pinnochio.anatomy.plan import Plan
from pinnochio.anatomy.segmentation import read_labels
from pinnochio.anatomy.surfaces import read_surface
from pinnochio.logs import attach_log
from pinnochio.mechanics.settings import FemSettings
from pinnochio.scene.decisions import decide, write_decisions
from pinnochio.scene.reduction import reduced
from pinnochio.scene.settings import SceneSettings


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
    reach = interfaces["sliding_band"], interfaces["release"]
    decisions, field, limit = decide(patient, head, plan, settings, fem, *reach)
    made = reduced(patient, head, read_surface(files["skin"]), decisions, field, limit, interfaces)
    made.write(model)
    write_decisions(case, {"own": decisions}, scene)


if __name__ == "__main__":
    attach_log(snakemake.log[0])
    make_scene(
        snakemake.wildcards.case,
        dict(snakemake.input.items()),
        snakemake.params.interfaces,
        FemSettings(**snakemake.params.fem),
        SceneSettings(**snakemake.params.settings),
        snakemake.output.scene,
        snakemake.output.model,
    )
