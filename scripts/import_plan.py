"""Makes the checked plan, in LPS mm, of what a user gives for an imported patient."""

from pinnochio.importing.segmentation import check_plan, check_travel
from pinnochio.logs import attach_log
from pinnochio.model.surfaces import BoneSurface
from pinnochio.plans.plan import Plan


def import_plan(case: str, source: str, bone: str, plan: str) -> None:
    """Read a plan file or a folder of transforms and write it; InputError where it does not fit the patient's bone."""
    checked, surface = Plan.read(source, case), BoneSurface.read(bone)
    check_plan(checked, surface.segments, source)
    check_travel(plan=checked, bone=surface, segments=surface.segments, path=source)
    checked.write(plan)


if __name__ == "__main__":
    attach_log(snakemake.log[0])
    import_plan(
        case=snakemake.wildcards.case,
        source=snakemake.input.source,
        bone=snakemake.input.bone,
        plan=snakemake.output.plan,
    )
