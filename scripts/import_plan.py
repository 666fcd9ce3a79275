"""Makes the checked plan, in LPS mm, of what a user gives for an imported patient."""

from pinnochio.importing.segmentation import check_plan, check_travel
from pinnochio.logs import attach_log
from pinnochio.model.surfaces import BoneSurface
from pinnochio.plans.plan import Plan


def import_plan(case: str, source: str, bone: str, segments: tuple[str, ...], plan: str) -> None:
    """Read a plan file or a folder of transforms and write it; InputError where it does not fit the patient's bone."""
    checked = Plan.read(source, case)
    check_plan(checked, segments, source)
    check_travel(plan=checked, bone=BoneSurface.read(bone), segments=segments, path=source)
    checked.write(plan)


if __name__ == "__main__":
    attach_log(snakemake.log[0])
    import_plan(
        case=snakemake.wildcards.case,
        source=snakemake.input.source,
        bone=snakemake.input.bone,
        segments=tuple(snakemake.params.segments),
        plan=snakemake.output.plan,
    )
