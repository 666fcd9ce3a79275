"""What a run says on the console: how many jobs are done, which stage is running, how long it may take; and errors.

Everything that Snakemake says goes to its own log in `.snakemake/log` as ever.
"""

import logging
import os
import re
import time
from collections import Counter
from collections.abc import Callable
from typing import TextIO

from pinnochio.logs import last_line, warnings_in

EVERY = 20.0  # s between two lines where the console keeps every line
MOST = 20  # warnings of stages that are shown at the end
REASON = re.compile(r"[\w.]*(Error|Exception|Interrupt)\b")  # so ends the log of a stage that says why it failed
KNOWN = 0.1  # of the jobs, which tell how long the others may take


def in_words(seconds: float) -> str:
    """A time as people say it."""
    if seconds < 90:
        return f"{max(1, round(seconds / 10)) * 10} s"
    return f"{round(seconds / 60)} min" if seconds < 5400 else f"{seconds / 3600:.1f} h"


class Console(logging.Handler):
    """Shows the progress of Snakemake's jobs: on a terminal on one line that changes, else on a line now and then."""

    def __init__(self, runs: Callable[[], bool], stream: TextIO):
        """runs: whether jobs are run, not only listed."""
        super().__init__()
        self.runs, self.stream = runs, stream
        self.jobs, self.done, self.began = 0, 0, 0.0
        self.running: dict[int, tuple[str, list[str]]] = {}  # rule and logs by job
        self.changing = stream.isatty() and os.environ.get("TERM") != "dumb"
        self.said, self.drawn = -EVERY, False
        self.warnings: list[str] = []
        self.failed: dict[int, str] = {}  # what failed and why, by job

    def filter(self, record: logging.LogRecord) -> bool:
        """Takes what concerns jobs."""
        events = ("run_info", "job_info", "job_finished", "job_error", "group_error")
        return getattr(record, "event", None) in events and self.runs()

    def emit(self, record: logging.LogRecord) -> None:
        now = time.monotonic()
        if record.event == "run_info":
            self.began = now
            self.jobs = sum(count for rule, count in record.stats.items() if rule != "total")
        elif record.event == "job_info":
            self.running[record.jobid] = record.rule_name, list(getattr(record, "log", ()))
            if not record.output:  # a target: its message says where to look
                self.clear()
                self.stream.write(f"{record.rule_msg or record.rule_name}\n")
                self.said = now  # it is the last line, or nearly so
        elif record.event == "group_error":  # of its jobs the one that wrote last has failed; all follow as single ones
            numbers = {info["jobid"] for info in record.job_error_info}
            last = max(numbers, key=self.last_written)
            self.failed = {number: words for number, words in self.failed.items() if number not in numbers}
            self.fail(last)
            for number in numbers - {last}:
                self.running.pop(number, None)
        elif record.event == "job_error":
            if not getattr(record, "indent", False):
                self.fail(getattr(record, "jobid", 0))
        elif record.job_id in self.running:
            self.done += 1
            self.failed.pop(record.job_id, None)
            for log in self.running.pop(record.job_id)[1]:
                self.warnings = list(dict.fromkeys([*self.warnings, *warnings_in(log)]))
        self.show(now)

    def fail(self, number: int) -> None:
        """Keep why a job has failed: the error that its log ends with, or that there is none."""
        rule, logs = self.running.pop(number, ("a job", []))
        words = next(filter(None, map(last_line, logs)), "")
        if not REASON.match(words):
            words = f"its log ends without an error, as where it was killed for its memory: {', '.join(logs) or 'none'}"
        self.failed[number] = f"{rule}: {words}"

    def last_written(self, number: int) -> float:
        """When the newest of the job's logs was written; 0 where there is none."""
        logs = self.running.get(number, ("", []))[1]
        return max((os.path.getmtime(log) for log in logs if os.path.exists(log)), default=0.0)

    def line(self, now: float) -> str:
        """The line that says how far the run is and, once some jobs have told, how long the others may take."""
        stages = Counter(rule for rule, _ in self.running.values())
        names = ", ".join(f"{rule} x {count}" if count > 1 else rule for rule, count in stages.items())
        left = (now - self.began) * (self.jobs - self.done) / max(self.done, 1)
        time_left = f"; about {in_words(left)} left" if self.done > KNOWN * self.jobs else ""
        return f"{self.done} of {self.jobs} jobs done; {names or 'starting'}{time_left}"

    def summary(self) -> None:
        """Show once what stages have warned of, and what failed and why."""
        self.clear()
        for place, words in enumerate(self.failed.values(), 1):
            self.stream.write(f"Failed ({place} of {len(self.failed)}): {words}\n")
        self.failed = {}
        for words in self.warnings[:MOST]:
            self.stream.write(f"Warning: {words}\n")
        if len(self.warnings) > MOST:
            self.stream.write(f"and {len(self.warnings) - MOST} warnings more, in the logs of the results\n")
        self.warnings = []
        self.stream.flush()

    def show(self, now: float) -> None:
        finished = self.done == self.jobs
        if self.changing:
            self.clear()
            if not finished:
                width = os.get_terminal_size(self.stream.fileno()).columns
                self.stream.write(self.line(now)[: width - 1])
                self.drawn = True
        elif now - self.said > EVERY and not finished and self.running:
            self.stream.write(self.line(now) + "\n")
            self.said = now
        self.stream.flush()

    def clear(self) -> None:
        """Take the changing line away, so that something else can be said."""
        if self.drawn:
            self.stream.write("\r\033[K")
            self.drawn = False


class Quiet(logging.Filter):
    """Lets through warnings, errors, what the workflow itself says, and that nothing is to be done."""

    def __init__(self, console: Console):
        super().__init__()
        self.console, self.failed = console, False

    def filter(self, record: logging.LogRecord) -> bool:
        if not self.console.runs():
            return True
        event = getattr(record, "event", None)
        words = str(record.msg)
        ours = record.pathname.endswith(".smk") or words.startswith("Nothing to be done")
        ours = ours or (self.failed and words.startswith("Complete log"))
        wrong = record.levelno >= logging.ERROR or event in ("job_error", "group_error")
        self.failed |= wrong
        shown = wrong or record.levelno >= logging.WARNING or (event is None and ours)
        if shown:
            self.console.clear()
        return shown


def quieten(logger: logging.Logger, runs: Callable[[], bool]) -> Console | None:
    """Show progress instead of all that Snakemake says on its console; without a console it is left alone."""
    for handler in logger.handlers:
        if handler.name == "DefaultStreamHandler":
            console = Console(runs, handler.stream)
            handler.addFilter(Quiet(console))
            logger.addHandler(console)
            return console
    return None
