"""Makes of what is brought of a patient: labels and surfaces, the checked plan, what else is known."""

from collections.abc import Mapping
from pathlib import Path

from pinnochio.logs import attach_log
from pinnochio.stages import Stages

# Imported when they are run: of a further plan the patient's are not.
COVARIATES, HEAD = "scripts.patient.import_covariates", "scripts.patient.import_segmentation"
SURFACES = ("bone", "skin", "report")


def import_case(
    case: str,
    files: Mapping[str, object],
    outputs: Mapping[str, str],
    scan: Mapping,
    plan: Mapping,
    known: Mapping | None,
    record: str,
) -> None:
    """Run the stages whose outputs are named: covariates; labels; those of SURFACES; plan.

    files: segmentation, volume, markups, source (of the plan), described (of covariates), and bone and labels where
    they are not made here; scan, plan: settings of :func:`import_labels` and :func:`import_plan`; known: as of
    :func:`import_covariates`.
    """
    labels = outputs.get("labels") or files.get("labels", "")
    head = str(Path(labels).parent / ".head.json")
    with Stages(record) as stages:
        if "covariates" in outputs:
            read = {"source": files["described"] if known is None else None}
            stages(f"{COVARIATES}:import_covariates", read, {"covariates": outputs["covariates"]}, {"known": known})
        if "labels" in outputs:
            read = {name: files[name] for name in ("segmentation", "volume", "markups")}
            stages(f"{HEAD}:import_labels", read, {"labels": labels, "head": head}, {"case": case, **scan})
        if "bone" in outputs:
            read, made = {"labels": labels, "head": head}, {name: outputs[name] for name in SURFACES}
            stages(f"{HEAD}:import_surfaces", read, made, {"bone_edge": scan["bone_edge"]})
        if "plan" in outputs:
            read = {"source": files["source"], "bone": outputs.get("bone") or files["bone"], "labels": labels}
            stages("scripts.patient.import_plan:import_plan", read, {"plan": outputs["plan"]}, {"case": case, **plan})


def settings_of(params: Mapping) -> dict[str, dict]:
    """Settings of scan and plan for :func:`import_case`, of a rule's params or of values by the same names."""
    scan = {name: params[name] for name in ("orientation", "unlabelled_muscle", "bone_edge", "cuts", "accept")}
    scan |= {"segments": tuple(params["segments"]), "repair_limit": params["repair"]["limit"]}
    plan = {name: params[name] for name in ("limit", "share", "foreign")}
    return {name: {"label_values": params["labels"], **values} for name, values in {"scan": scan, "plan": plan}.items()}


if __name__ == "__main__":
    attach_log(snakemake.log[0])
    params, files = snakemake.params, dict(snakemake.input.items())
    import_case(
        case=snakemake.wildcards.case,
        files=files | {"volume": files.get("volume") or None, "markups": list(files.get("markups", []))},
        outputs=dict(snakemake.output.items()),
        **settings_of(params=params),
        known=params.get("known"),
        # One of each rule: those of a new patient run side by side.
        record=Path(snakemake.output[0]).with_name(f".{snakemake.rule}.json"),
    )
