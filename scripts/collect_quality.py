"""Makes the table with the quality of every patient's model of their reports."""

import json
from collections.abc import Sequence
from pathlib import Path

from pinnochio.logs import attach_log
from pinnochio.metrics.quality import write_quality


def collect_quality(reports: Sequence[str], segments: Sequence[str], cohort: str, table: str) -> None:
    """One row per report; the cohort's name goes into the captions of the twins beside `table`."""
    found = [json.loads(Path(path).read_text(encoding="utf-8")) for path in reports]
    write_quality(found, table, segments, cohort)


if __name__ == "__main__":
    attach_log(snakemake.log[0])
    collect_quality(
        reports=snakemake.input.reports,
        segments=snakemake.params.segments,
        cohort=snakemake.params.cohort,
        table=snakemake.output.table,
    )
