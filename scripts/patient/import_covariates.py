"""Makes one file of what is known of a patient beside anatomy and motion."""

from collections.abc import Mapping

from pinnochio.importing.cohort import COVARIATES
from pinnochio.json_text import read_stored_json, write_json


def import_covariates(known: Mapping | None, source: str | None, covariates: str) -> None:
    """Write each of COVARIATES, null where it is not known.

    known: what the case table says; None: the JSON file `source` of a virtual patient says it.
    """
    known = read_stored_json(source) if known is None else known
    write_json(covariates, {name: known.get(name) for name in COVARIATES})
