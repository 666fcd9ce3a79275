"""Opens the planner on a prepared patient, in a browser on this machine: `python workflow/plan.py --help`."""

import argparse
import os
import sys

os.environ.setdefault("OMP_WAIT_POLICY", "passive")  # as in the workflow: idle threads leave the cores to others
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # to wake a second one costs more than a patient's products [X]

from pinnochio.errors import InputError  # noqa: E402
from pinnochio.mechanics.settings import FemSettings  # noqa: E402
from pinnochio.plans.plan import Plan  # noqa: E402
from pinnochio.training.device import choose_device  # noqa: E402
from studies.planner.forecast import Forecaster  # noqa: E402
from studies.planner.page import Page  # noqa: E402
from studies.planner.prepared import Prepared  # noqa: E402
from studies.planner.scan import read_scan  # noqa: E402
from studies.planner.serving import check_free  # noqa: E402
from studies.planner.session import Session  # noqa: E402
from studies.planner.wishing import Wishing  # noqa: E402


def open_planner(prepared: Prepared, port: int, browser: bool) -> None:
    """Load patient and models, then serve the page on the loopback until the process is ended; InputError if not."""
    check_free(port)
    try:
        forecaster = Forecaster(prepared, choose_device(0, 1), threads=os.cpu_count())  # side by side, each on one core
    except InputError:
        raise
    except (KeyError, TypeError, ValueError) as error:
        problem = f"the patient or its models were made by another version ({type(error).__name__}: {error})"
        raise InputError(prepared.case, prepared.archive, problem, "pack the models and prepare it again") from error
    plans = {name: Plan.read(path, prepared.case) for name, path in prepared.plans.items()}
    try:
        scan = read_scan(prepared)
    except InputError as error:
        print(f"The scan is not shown: {error}", file=sys.stderr)
        scan = None
    session = Session(forecaster.patient, prepared.case, plans, prepared.home)
    fem = FemSettings(**prepared.fem)
    wishing = Wishing(forecaster.patient, prepared.case, fem, prepared.invert)
    Page(session, forecaster, wishing, scan).serve(port, browser)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.ArgumentDefaultsHelpFormatter)
    parser.add_argument("prepared", help="planner.json of the patient, written by `snakemake planner`")
    parser.add_argument("--port", type=int, default=8050, help="port on 127.0.0.1; 0 for any that is free")
    parser.add_argument("--no-browser", action="store_true", help="only print the address")
    options = parser.parse_args()
    try:
        open_planner(prepared=Prepared.read(options.prepared), port=options.port, browser=not options.no_browser)
    except InputError as error:
        sys.exit(str(error))
