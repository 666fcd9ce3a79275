"""Makes the report of a study: one page of its tables, figures, patients and provenance."""

from collections.abc import Mapping, Sequence
from pathlib import Path

from pinnochio.logs import attach_log
from pinnochio.report.page import write_page


def write_report(
    template: str,
    tables: Sequence[str],
    figures: Sequence[str],
    curves: Mapping[str, str],
    patients: Mapping[str, Mapping[str, str]],
    provenance: str,
    output: str,
) -> None:
    """Write the page by the template, with the captions that lie beside it.

    tables: HTML twins; figures: PNG files, named like their tables; curves: pictures of trainings by method; patients:
    by case its `picture`, its `view` and, where there is one, its `volume`.
    """
    by_part = {Path(path).stem: {Path(path).stem: path} for path in figures}
    by_part |= {"training": curves} if curves else {}
    by_name = {Path(path).stem: path for path in tables}
    write_page(Path(template).parent, by_name, by_part, patients, provenance, output)


if __name__ == "__main__":
    attach_log(snakemake.log[0])
    given = snakemake.input
    kinds = {"picture": given.pictures, "view": given.views} | ({"volume": given.volumes} if given.volumes else {})
    write_report(
        template=given.template,
        tables=given.tables,
        figures=given.figures,
        curves=dict(zip(snakemake.params.learned, given.curves, strict=True)),
        patients={
            case: {kind: files[i] for kind, files in kinds.items()} for i, case in enumerate(snakemake.params.cases)
        },
        provenance=given.provenance,
        output=snakemake.output.page,
    )
