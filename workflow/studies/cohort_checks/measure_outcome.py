"""Makes one patient's rows of a table about the simulated outcome, by the module of the library that measures them."""

from collections.abc import Mapping
from importlib import import_module

from pinnochio.columns import write_rows
from pinnochio.logs import attach_log
from pinnochio.virtual.outcome import Operation


def measure_outcome(
    module: str,
    case: str,
    inputs: Mapping[str, str],
    outcome: dict,
    label_values: dict[str, int],
    segments: tuple[str, ...],
    seed: int,
    arguments: Mapping,
    table: str,
) -> None:
    """Write what `measure` of the module finds, with its own arguments; inputs and the rest as in virtual_outcome."""
    measuring = import_module(module)
    operation = Operation.read(
        case=case, inputs=inputs, labels=label_values, segments=segments, outcome=outcome, seed=seed
    )
    write_rows(measuring.measure(operation, **arguments), table, measuring.CASE)


if __name__ == "__main__":
    attach_log(snakemake.log[0])
    files = {name: path for name, path in snakemake.input.items() if name in ("truth", "template")}
    measure_outcome(
        **{name: snakemake.params[name] for name in ("module", "outcome", "seed")},
        case=snakemake.wildcards.case,
        inputs=dict(snakemake.input.items()),
        label_values=snakemake.params.labels,
        segments=tuple(snakemake.params.segments),
        arguments=snakemake.params.arguments | files,
        table=snakemake.output.table,
    )
