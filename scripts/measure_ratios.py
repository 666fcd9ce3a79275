"""Makes the table of soft-to-hard tissue ratios of the simulated outcomes, beside the clinical bands."""

from collections.abc import Sequence

from pinnochio.logs import attach_log
from pinnochio.metrics.volume import read_truth
from pinnochio.virtual.aftermath import read_landmarks
from pinnochio.virtual.ratios import motions, tabulate, write_ratios


def measure_ratios(cases: Sequence[str], landmarks: Sequence[str], truths: Sequence[str], table: str) -> None:
    """Motion of the landmarks in each truth against that of the bone as operated; one row per landmark."""
    patients = []
    for case, marks, truth in zip(cases, landmarks, truths, strict=True):
        *field, executed = read_truth(truth, case)
        patients.append(motions(read_landmarks(marks), executed, *field))
    write_ratios(tabulate(patients), table)


if __name__ == "__main__":
    attach_log(snakemake.log[0])
    measure_ratios(
        cases=snakemake.params.cases,
        landmarks=snakemake.input.landmarks,
        truths=snakemake.input.truths,
        table=snakemake.output.table,
    )
