"""Makes the report of a study: one page of its tables, figures, patients and provenance."""

from collections.abc import Mapping, Sequence
from pathlib import Path

from pinnochio.logs import attach_log
from pinnochio.report.study_page import write_page


def write_report(
    titles: Mapping[str, str],
    captions: Mapping[str, str],
    tables: Sequence[str],
    figures: Sequence[str],
    curves: Mapping[str, str],
    patients: Mapping[str, Mapping[str, str]],
    provenance: str,
    output: str,
    cases: str | None = None,
    methods: Sequence[str] = (),
    chart: str | None = None,
    qualities: Mapping[str, str] | None = None,
) -> None:
    """Write the page.

    titles, captions, cases, methods, chart, qualities: as of write_page; tables: HTML twins; figures: PNG files, named
    like their tables; curves: pictures of trainings by method; patients: by case its `picture`, its `view` and, where
    there is one, its `volume`.
    """
    by_part = {Path(path).stem: {Path(path).stem: path} for path in figures}
    by_part |= {"training": curves} if curves else {}
    write_page(
        titles=titles,
        captions=captions,
        tables={Path(path).stem: path for path in tables},
        figures=by_part,
        patients=patients,
        provenance=provenance,
        path=output,
        cases=cases,
        methods=methods,
        chart=chart,
        qualities=qualities,
    )


if __name__ == "__main__":
    attach_log(snakemake.log[0])
    files = {kind: snakemake.input[f"{kind}s"] for kind in ("picture", "view", "volume")}
    write_report(
        titles=snakemake.params.titles,
        captions=snakemake.params.captions,
        tables=snakemake.input.tables,
        figures=snakemake.input.figures,
        curves=dict(zip(snakemake.params.learned, snakemake.input.curves, strict=True)),
        patients={
            case: {kind: paths[number] for kind, paths in files.items() if paths}
            for number, case in enumerate(snakemake.params.cases)
        },
        provenance=snakemake.input.provenance,
        output=snakemake.output.page,
        cases=snakemake.input.get("cases") or None,
        methods=snakemake.params.methods,
        chart=snakemake.input.get("chart") or None,
        qualities=dict(zip(snakemake.params.everyone, snakemake.input.qualities, strict=True)),
    )
