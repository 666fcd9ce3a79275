"""The console of a run: progress, what is let through, and what is not begun unasked."""

import io
import logging
import os
from types import SimpleNamespace

import pytest

from pinnochio.errors import InputError
from pinnochio.study.console import Console, in_words, quieten
from pinnochio.study.unfinished import refuse_unfinished

COUNTS = {"mesh": 4, "train": 2}


@pytest.mark.parametrize(("seconds", "said"), [(0, "10 s"), (44, "40 s"), (200, "3 min"), (7200, "2.0 h")])
def test_times_are_said_in_words(seconds, said):
    assert in_words(seconds) == said


def test_the_time_left_is_that_of_as_many_jobs_as_are_not_done():
    console = Console(lambda: True, io.StringIO())
    console.jobs, console.done, console.running = 30, 3, {1: ("mesh", []), 2: ("mesh", []), 3: ("train", [])}
    assert console.line(100.0) == "3 of 30 jobs done; mesh x 2, train"  # too few to tell
    console.done = 10
    assert console.line(300.0) == "10 of 30 jobs done; mesh x 2, train; about 10 min left"


def record(level=logging.INFO, message="", path="scheduler.py", **event) -> logging.LogRecord:
    made = logging.LogRecord("snakemake", level, path, 1, message, None, None)
    vars(made).update(event)
    return made


@pytest.fixture
def logger():
    """A logger as Snakemake has it, and what its console shows."""
    made, stream = logging.Logger("snakemake"), io.StringIO()
    handler = logging.StreamHandler(stream)
    handler.name = "DefaultStreamHandler"
    made.addHandler(handler)
    return SimpleNamespace(handle=made.handle, said=stream.getvalue, logger=made)


def test_progress_and_errors_are_shown_and_nothing_else(logger):
    quieten(logger.logger, lambda: True)
    logger.handle(record(event="run_info", stats=COUNTS | {"total": 6}, message="Job stats"))
    logger.handle(record(message="Select jobs to execute..."))
    logger.handle(
        record(event="job_info", jobid=1, rule_name="mesh", rule_msg="Mesh", output=["a"], message="Reason: x")
    )
    logger.handle(record(event="job_finished", job_id=1, message="Finished job"))
    logger.handle(record(logging.WARNING, "a warning"))
    logger.handle(record(message="said by the study", path="workflow/common.smk"))
    logger.handle(record(logging.ERROR, "it broke", event="job_error"))
    logger.handle(record(message="Complete log(s): here"))
    said = logger.said()
    assert "0 of 6 jobs done; mesh\n" in said
    for shown in ("a warning", "said by the study", "it broke", "Complete log(s): here"):
        assert shown in said
    for hidden in ("Job stats", "Select jobs", "Reason", "Finished job"):
        assert hidden not in said


def test_the_message_of_a_target_says_where_to_look(logger):
    quieten(logger.logger, lambda: True)
    logger.handle(record(event="run_info", stats={"report": 1}))
    logger.handle(record(event="job_info", jobid=1, rule_name="report", rule_msg="see report.html", output=[]))
    assert logger.said() == "see report.html\n"


def test_the_list_of_what_failed_stands_at_the_end_with_reasons(logger, tmp_path):
    """A job that came right when it was sent again is not on it."""
    log, console = tmp_path / "a.log", quieten(logger.logger, lambda: True)
    log.write_text("Traceback\npinnochio.errors.InputError: case 'P3': scan.ply: it is empty\n\n")
    for number in (1, 2):
        logger.handle(record(event="job_info", jobid=number, rule_name="import_case", output=["a"], log=[str(log)]))
        logger.handle(record(logging.ERROR, "it broke", event="job_error", jobid=number))
    logger.handle(record(event="job_info", jobid=2, rule_name="import_case", output=["a"], log=[str(log)]))
    logger.handle(record(event="job_finished", job_id=2))
    console.summary()
    reason = "import_case: pinnochio.errors.InputError: case 'P3': scan.ply: it is empty"
    assert [line for line in logger.said().splitlines() if "Failed" in line] == [f"Failed (1 of 1): {reason}"]


def test_of_a_group_what_wrote_last_has_failed_and_what_was_killed_is_named_by_its_log(logger, tmp_path):
    first, second = logs = tmp_path / "first.log", tmp_path / "P7.log"
    first.write_text("2026-01-01 10:00:00,000 INFO root: done\n")
    os.utime(first, (1, 1))
    second.touch()
    console = quieten(logger.logger, lambda: True)
    for number, log in enumerate(logs):
        logger.handle(record(event="job_info", jobid=number, rule_name="mesh", output=["a"], log=[str(log)]))
    logger.handle(record(logging.ERROR, event="group_error", job_error_info=[{"jobid": 0}, {"jobid": 1}]))
    for number in (0, 1):
        logger.handle(record(logging.ERROR, event="job_error", jobid=number, indent=True))
    console.summary()
    (said,) = [line for line in logger.said().splitlines() if "Failed" in line]
    assert "killed for its memory" in said and said.endswith("P7.log") and not console.running


def test_what_stages_warned_of_is_shown_once_at_the_end(logger, tmp_path):
    line = "2026-01-01 10:00:00,000 {} {}: case 'P1': no muscle\n"
    log = tmp_path / "a.log"
    log.write_text(line.format("WARNING", "pinnochio.importing.x") * 2 + line.format("WARNING", "py.warnings"))
    console = quieten(logger.logger, lambda: True)
    logger.handle(record(event="run_info", stats=COUNTS | {"total": 6}))
    for job in (1, 2):
        words = {"jobid": job, "rule_name": "mesh", "rule_msg": "", "output": ["a"], "log": [str(log)]}
        logger.handle(record(event="job_info", **words))
        logger.handle(record(event="job_finished", job_id=job))
    before = logger.said()
    console.summary()
    assert "no muscle" not in before and logger.said().removeprefix(before) == "Warning: case 'P1': no muscle\n"


def test_a_list_of_jobs_is_left_as_it_is(logger):
    quieten(logger.logger, lambda: False)
    logger.handle(record(event="run_info", stats=COUNTS, message="Job stats"))
    logger.handle(record(event="job_info", message="Reason: missing"))
    assert "Job stats" in logger.said() and "Reason" in logger.said() and "jobs done" not in logger.said()


def test_one_line_changes_on_a_terminal():
    class Terminal(io.StringIO):
        def isatty(self):
            return True

        def fileno(self):
            raise OSError

    console = Console(lambda: True, Terminal())
    assert console.changing
    console.drawn = True
    console.clear()
    assert console.stream.getvalue() == "\r\033[K" and not console.drawn


def refuse(targets, counts):
    refuse_unfinished(targets, counts | {"total": sum(counts.values())}, 2, "results")


@pytest.mark.parametrize("target", ["report", "figures", "results/figures/V01.png"])
def test_a_report_does_not_begin_a_study(target):
    with pytest.raises(InputError, match="6 jobs are left.*--cores 2 all " + target):
        refuse([target], {"predict_cases": 2, "train": 4})


def test_what_is_wished_is_begun_and_what_is_measured_is_drawn():
    for targets in [["all", "report"], ["tables"], ["results/cases/V01/model.h5"], []]:
        refuse(targets, {"predict_cases": 1000})
    refuse(["report"], {"render_case": 10})
