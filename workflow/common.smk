"""The study of the configuration, and what the rules ask beside it."""

import os
import threading
from contextlib import contextmanager
from functools import cache
from pathlib import Path

from snakemake.logging import logger

from pinnochio.code import ROOT, code_hash, source_file, stages
from pinnochio.errors import InputError, StorageError
from pinnochio.files import check_brought, check_writable, fingerprint
from pinnochio.methods.names import BASELINE
from pinnochio.methods.registry import graph_networks
from pinnochio.patients.model_archive import READ_BY_NETWORKS
from pinnochio.report.parts import FOLDED, PARTS
from pinnochio.study.configuration import check_config
from pinnochio.study.console import quieten
from pinnochio.study.inputs.rules import RuleInputs
from pinnochio.study.needs import check_needs
from pinnochio.study.patients import oddities
from pinnochio.study.provenance import changed_since, forgotten
from pinnochio.study.schema import checked, read_schema, refuse_doubled
from pinnochio.study.study import Study
from pinnochio.study.unfinished import refuse_unfinished
from pinnochio.volume_size import millions

# Jobs keep what Python compiles of their modules: else each of them takes seconds to compile all that it imports.
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
# Idle OpenMP threads of a job sleep; spinning they take the cores from the compiled loops.
os.environ.setdefault("OMP_WAIT_POLICY", "passive")
# No job takes more cores than it asks for.
os.environ.setdefault("IGL_NUM_THREADS", "1")
os.environ.setdefault("ITK_GLOBAL_DEFAULT_NUMBER_OF_THREADS", "1")
# To wake a second thread of OpenBLAS costs 4 ms [X], more than any of the products here; Snakemake gives it as many as
# the job has.
shell.prefix("set -euo pipefail; export OPENBLAS_NUM_THREADS=1; ")

HERE = Path(workflow.current_basedir.get_path_or_uri(secret_free=True))


@contextmanager
def plainly():
    """What is wrong with configuration, table or patient ends the run in one line: of an error that nobody catches
    Snakemake shows lines of code as well."""
    try:
        yield
    except (InputError, StorageError) as error:
        logger.error(str(error))
        raise SystemExit(1) from None


with plainly():
    check_brought("-", HERE)
    if workflow.is_main_process:
        for file in workflow.configfiles:
            refuse_doubled(file)
    config.update(checked(config, read_schema(ROOT)))
    check_config(config)

    RESULTS = config["pathvars"]["results"]
    RECORD = f"{RESULTS}/provenance.json"
    if workflow.is_main_process and forgotten(RECORD):
        if changed := changed_since(RECORD, config):
            logger.warning(
                f"Snakemake has no metadata of {RESULTS}, which was made with another configuration: {', '.join(changed)}. "
                "What lies there counts as up to date. Delete what shall be made again."
            )
    BENCHMARKS = f"{RESULTS}/benchmarks"
    STUDY = Study.of(config)
    INPUTS = RuleInputs(STUDY)
    NETWORKS = graph_networks(config)
    SEED, COHORT = config["seed"], STUDY.cohort.name
    TRAINING_SEED = SEED + 1000 * config["repeat"]
    # Jobs that are timed have the machine for themselves; no number of cores is given where nothing runs, as by --list.
    ALL_CORES = workflow.resource_settings.cores or 1
    # A job of a cluster does not hear of --resources: it asks its step for a GPU only where SLURM has granted it one.
    GPU = int(not workflow.remote_exec or "SLURM_GPUS_ON_NODE" in os.environ)
    if workflow.is_main_process and STUDY.methods.unbounded:
        logger.warning(
            f"Left out: {', '.join(STUDY.methods.unbounded)}. Bounds read the truth, which is known of the virtual cohort alone."
        )
    if workflow.is_main_process and STUDY.methods.untrained:
        logger.warning(
            f"Left out: {', '.join(STUDY.methods.untrained)}. Training by cross-validation needs a post-operative scan of at least "
            f"one patient per fold; {len(STUDY.cohort.scanned)} of {len(STUDY.cohort.cases)} patients have one, and 'folds' is "
            f"{config['folds']}."
        )
    if workflow.is_main_process and STUDY.choice:
        if STUDY.choice.archive:
            check_brought("-", STUDY.choice.folder)
        if STUDY.choice.in_words:
            logger.info(STUDY.choice.in_words)

    if workflow.is_main_process:
        for odd in oddities(STUDY.new_patients.values()):
            logger.warning(odd)


def any_of(names):
    """Wildcard constraint: one of the names; where there is none, a name that nothing bears."""
    return "|".join(names) or "none"


def check_networks(key, names):
    """End the run where a key of the configuration names what is not among `variants`."""
    with plainly():
        if unknown := [name for name in names if name not in config["variants"]]:
            raise InputError(
                "-",
                "configuration",
                f"{key} names {unknown[0]!r}, which is not among 'variants'",
                "name a learned method",
            )


def megabytes(usual):
    """Resource: memory, twice as much for a job that is sent again; usual: a number, or of a job's wildcards and input."""
    if callable(usual):
        return lambda wildcards, input, attempt: usual(wildcards, input) * attempt
    return lambda wildcards, attempt: usual * attempt


def captioned(path, name=None):
    """An output that `snakemake --report` shows: with the caption of that name, by default the file's own."""
    name = name or Path(path).stem
    caption = f"../workflow/report/{name}.rst"
    return report(path, caption=caption, category=PARTS.get(name, "Patients"))


@cache
def code_of(*names):
    """Content hash of stage scripts and modules, by their dotted names, with all that they import of the project.

    An edit of an imported module triggers no rerun by itself; this parameter does.
    """
    return code_hash(*map(source_file, names))


def content(*inputs):
    """Params function: a hash of what inputs that users bring hold: an older file in place of a newer one, as after
    `cp -p`, triggers no rerun by its time. Of wildcards alone: what comes of a rule's inputs triggers none either.
    """
    return lambda wildcards: fingerprint(
        (file for brought in inputs for file in listed(brought(wildcards))), RESULTS
    )


def listed(files):
    return [files] if isinstance(files, str) else files


def code_with_method(script, reference=INPUTS.prediction.predictor):
    """Params function: the same with a module of the job's method, which the script imports by its name."""
    return lambda wildcards: code_of(script, reference(wildcards))


CONSOLE = None
if workflow.is_main_process and not (
    workflow.output_settings.verbose or os.environ.get("VERBOSE")
):
    CONSOLE = quieten(logger, runs=lambda: not workflow.dryrun)


onstart:
    with plainly():
        check_writable(RESULTS)
        refuse_unfinished(
            targets=list(workflow.dag_settings.targets),
            counts=workflow.dag.stats()[1],
            cores=ALL_CORES,
            results=RESULTS,
        )
        if workflow.local_exec:
            jobs = [
                (job.rule.name, job.resources.get("mem_mb", 0), job.threads)
                for job in workflow.dag.needrun_jobs()
            ]
            said = check_needs(jobs, ALL_CORES, config["mesh"]["nodes"], RESULTS)
            if len(jobs) > 10:
                logger.info(said)


def stop_timers():
    """Snakemake leaves a timer for each job that started, and would not end before the last has run out."""
    for thread in threading.enumerate():
        if isinstance(thread, threading.Timer):
            thread.cancel()


def finish():
    stop_timers()
    if CONSOLE:
        CONSOLE.summary()


onsuccess:
    finish()


def redo_failed():
    """Of a job that fails Snakemake puts older outputs back and records that it made them: they are marked as incomplete,
    so that the same command makes them again."""
    for job in workflow.scheduler.failed:
        for one in job if job.is_group() else [job]:
            workflow.persistence.started(one)


onerror:
    redo_failed()
    finish()
