"""Makes the data card of the virtual cohort."""

from collections.abc import Mapping, Sequence
from pathlib import Path

from pinnochio.files import replacing
from pinnochio.json_text import read_stored_json
from pinnochio.logs import attach_log
from pinnochio.plans.plan import Plan
from pinnochio.virtual.card import data_card


def describe_cohort(cases: Sequence[str], settings: Mapping, card: str) -> None:
    """Write the card (Markdown) of the cases, whose files lie in `{folder of the card}/{case}/`.

    settings: seed, code, virtual and labels of :func:`pinnochio.virtual.card.data_card`.
    """
    folder = Path(card).parent
    anatomies = [read_stored_json(folder / case / "anatomy.json") for case in cases]
    plans = [Plan.read(folder / case / "plan.json", case) for case in cases]
    with replacing(card) as temporary:
        temporary.write_text(data_card(anatomies, plans, **settings), encoding="utf-8")


if __name__ == "__main__":
    attach_log(snakemake.log[0])
    describe_cohort(cases=snakemake.params.cases, settings=snakemake.params.settings, card=snakemake.output.card)
