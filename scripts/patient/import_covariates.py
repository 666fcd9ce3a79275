"""Makes one file of what is known of a patient beside anatomy and motion."""

import json
from collections.abc import Mapping

from pinnochio.files import replacing
from pinnochio.importing.cohort import COVARIATES
from pinnochio.json_text import read_stored_json


def import_covariates(known: Mapping | None, source: str | None, covariates: str) -> None:
    """Write each of COVARIATES, null where it is not known.

    known: what the case table says; None: the JSON file `source` of a virtual patient says it.
    """
    known = read_stored_json(source) if known is None else known
    with replacing(covariates) as temporary:
        temporary.write_text(json.dumps({name: known.get(name) for name in COVARIATES}, indent=1) + "\n", "utf-8")
