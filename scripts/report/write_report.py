"""Makes the report of a study: one page of its tables, figures, patients and provenance, which needs nothing else."""

from collections.abc import Mapping, Sequence
from pathlib import Path

from plotly.offline import get_plotlyjs

from pinnochio.columns import read_table
from pinnochio.files import replacing
from pinnochio.json_text import read_stored_json
from pinnochio.logs import attach_log
from pinnochio.methods.names import written
from pinnochio.metrics.case_columns import CASES, scanned
from pinnochio.report.answer import sentences
from pinnochio.report.parts import FOLDED
from pinnochio.report.study_page import (
    SMALL,
    TEMPLATE,
    cohort_of,
    packed,
    paragraphs,
    photograph,
    picture,
    read_body,
    rounded,
)
from pinnochio.statistics.ranking import rank
from pinnochio.web_pages import render


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

    titles: of the parts, in the order of the page. captions: of each part, of a `picture` and of a `volume`, plain
    paragraphs. tables: HTML twins; figures: PNG files, named like their tables; curves: pictures of trainings by
    method; patients: by case the files of its `picture`, its `view` and, where there is one, its `volume`. cases: the
    table of CASES that the three sentences on top are made from, with the methods that they compare; chart: the picture
    under them; these are absent where no patient has a scan. qualities: by case the picture of its model.
    """
    record = read_stored_json(provenance)
    settings, study = record["config"], cohort_of(record["config"])
    ranking = rank(scanned(read_table(cases, CASES)), methods, settings["seed"]) if cases else None
    twins = {Path(path).stem: path for path in tables}
    drawn = {Path(path).stem: {Path(path).stem: path} for path in figures} | ({"training": curves} if curves else {})
    parts = [
        {
            "name": name,
            "title": title,
            "folded": name in FOLDED,
            "words": paragraphs(captions[name]),
            "table": rounded(read_body(twins[name])) if name in twins else "",
            "pictures": {written(label): picture(file) for label, file in drawn.get(name, {}).items()},
        }
        for name, title in titles.items()
        if name in twins or name in drawn
    ]
    shown = {
        case: {
            "pictures": {name: photograph(files[name]) for name in ("picture", "volume") if name in files},
            "view": read_stored_json(files["view"]),
        }
        for case, files in patients.items()
    }
    text = render(
        TEMPLATE,
        said=sentences(ranking, study[0].lower() + study[1:], settings["folds"], settings["motion"]) if ranking else [],
        demonstration=ranking is not None and not ranking.tested,
        chart=picture(chart) if chart else "",
        qualities={case: photograph(file, SMALL) for case, file in (qualities or {}).items()},
        written=written,
        parts=parts,
        patients=shown,
        words={name: paragraphs(captions[name]) for name in ("picture", "volume")},
        record=record,
        study=study,
        virtual=settings["cohort"] == "virtual",
        plotly=packed(get_plotlyjs()) if shown else "",
    )
    with replacing(output) as temporary:
        temporary.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    attach_log(snakemake.log[0])
    files = {kind: snakemake.input[f"{kind}s"] for kind in ("picture", "view", "volume")}
    write_report(
        **{name: snakemake.params[name] for name in ("titles", "captions", "methods")},
        **{name: snakemake.input[name] for name in ("tables", "figures", "provenance")},
        curves=dict(zip(snakemake.params.learned, snakemake.input.curves, strict=True)),
        patients={
            case: {kind: paths[number] for kind, paths in files.items() if paths}
            for number, case in enumerate(snakemake.params.cases)
        },
        output=snakemake.output.page,
        cases=snakemake.input.get("cases") or None,
        chart=snakemake.input.get("chart") or None,
        qualities=dict(zip(snakemake.params.cases, snakemake.input.qualities, strict=True)),
    )
