"""Makes the table with the quality of every patient's model of their reports."""

import json
from collections.abc import Sequence
from pathlib import Path

from pinnochio.evaluation.quality import write_quality
from pinnochio.logs import attach_log


def collect_quality(reports: Sequence[str], segments: Sequence[str], cohort: str, table: str) -> None:
    """One row per report; the cohort's name goes into the captions of the twins beside `table`."""
    found = [json.loads(Path(path).read_text(encoding="utf-8")) for path in reports]
    write_quality(found, table, segments, cohort)


if __name__ == "__main__":
    attach_log(snakemake.log[0])
    collect_quality(
        snakemake.input.reports,
        snakemake.params.segments,
        snakemake.params.cohort,
        snakemake.output.table,
    )
