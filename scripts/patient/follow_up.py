"""Makes of what is known of a case after surgery: registered skin, motion of the bones, where it is judged, truth."""

from collections.abc import Mapping
from pathlib import Path

from pinnochio.logs import attach_log
from pinnochio.stages import Stages
from scripts.cohort.carry_truth import carry_truth
from scripts.patient.choose_samples import choose_samples
from scripts.patient.register_postop import register_postop
from scripts.patient.register_segments import register_segments


def follow_up(
    case: str, files: Mapping[str, str], outputs: Mapping[str, str], settings: Mapping[str, Mapping], record: str
) -> None:
    """Run the stages whose outputs are named: postop; achieved and fits; judged; true_motion and lips_motion.

    files: what the stages read by their arguments' names; bones_of_postop besides, of the skin's own scan where they
    are, and lips_model; motion, the plan that the case is judged by, may be an output too. settings: by stage.
    """
    files = {**outputs, **files}

    def run(stage, read, made):
        stages(stage, read, made, {"case": case, **settings.get(stage.__name__, {})})

    with Stages(record) as stages:
        if "postop" in outputs:
            read = {name: files[name] for name in ("skin", "bone")} | {"postop": files["scan"]}
            if bones := files.get("bones_of_postop"):
                read |= {"postop_bones": bones, "labels": files["labels"]}
            run(register_postop, read, {"registered": outputs["postop"]})
        if "achieved" in outputs:
            read = {name: files[name] for name in ("postop_bones", "labels", "bone", "plan")}
            run(register_segments, read, {name: outputs[name] for name in ("achieved", "fits")})
        if "judged" in outputs:
            read = {"model": files["model"], "plan": files["motion"], "postop": files["postop"]}
            run(choose_samples, read, {"judged": outputs["judged"]})
        for motion, model in (("true_motion", "model"), ("lips_motion", "lips_model")):
            if motion in outputs:
                run(carry_truth, {"truth": files["truth"], "model": files[model]}, {"motion": outputs[motion]})


if __name__ == "__main__":
    attach_log(snakemake.log[0])
    params, made = snakemake.params, dict(snakemake.output.items())
    bones = {"label_values": params.labels}
    skin = {"nasion_above_maxilla": params.nasion_above_maxilla, "limit": params.limit}
    within = {"segment_limit": params.segment_limit, "segment_share": params.segment_share}
    follow_up(
        case=snakemake.wildcards.case,
        # Where the motion is registered here the case is judged by it, unless by the plan.
        files={"motion": made.get(params.motion)} | dict(snakemake.input.items()),
        outputs=made,
        settings={
            "register_postop": bones | skin | within,
            "register_segments": bones | {"limit": params.segment_limit, "share": params.segment_share},
            "choose_samples": {"samples": params.samples, "seed": params.seed},
        },
        record=Path(made[next(iter(made))]).with_name(f".{snakemake.rule}.json"),
    )
