"""What a run says on the console: how many jobs are done, which stage is running, how long it may take; and errors.

Everything that Snakemake says goes to its own log in `.snakemake/log` as ever.
"""

import csv
import logging
import os
import time
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TextIO

from pinnochio.code import ROOT
from pinnochio.logs import warnings_in

MEASURED = ROOT / "results/reference"  # stages.csv of the default study; in folders of their names of other results
NAME = "stages.csv"
SHORT = 1.5  # s, [X] a job that is too short to be measured
LONG = 15.0  # s, [X] mean of those that are, where the table is not there
TRUSTED = 60.0  # s of work that the table is trusted for before what is measured here outweighs it
EVERY = 20.0  # s between two lines where the console keeps every line
MOST = 20  # warnings of stages that are shown at the end


def expected_seconds(counts: Mapping[str, int], measured: Mapping[str, bool], results: str) -> dict[str, float]:
    """Seconds of a core that one job of each rule took in the committed study of these results, or else of the default.

    counts: jobs by rule; measured: whether the rule writes a benchmark file. A rule that the table does not know takes
    the mean of all, one that is not measured next to nothing.
    """
    rows = {"all": LONG}
    table = next((table for table in (MEASURED / Path(results).name / NAME, MEASURED / NAME) if table.is_file()), None)
    if table:
        with open(table, newline="", encoding="utf-8") as file:
            rows = {row["rule"]: float(row["cpu_seconds"]) / float(row["jobs"]) for row in csv.DictReader(file)}
    return {
        rule: rows.get(rule.removesuffix("_cases"), rows["all"]) if measured.get(rule) else SHORT for rule in counts
    }


def in_words(seconds: float) -> str:
    """A time as people say it."""
    if seconds < 90:
        return f"{max(1, round(seconds / 10)) * 10} s"
    if seconds < 5400:
        return f"{round(seconds / 60)} min"
    return f"{seconds / 3600:.1f} h"


@dataclass
class JobProgress:
    """Jobs of a run: waiting, running and done.

    counts: jobs by rule; expected: seconds of one job by rule, elsewhere or at another size; what is measured here
    scales it.
    """

    counts: Mapping[str, int]
    expected: Mapping[str, float]
    cores: int
    running: dict[int, tuple[str, float]] = field(default_factory=dict)
    taken: dict[str, list[float]] = field(default_factory=dict)

    @property
    def total(self) -> int:
        return sum(self.counts.values())

    @property
    def done(self) -> int:
        return sum(map(len, self.taken.values()))

    def start(self, job: int, rule: str, now: float) -> None:
        self.running[job] = rule, now

    def end(self, job: int, now: float) -> None:
        rule, began = self.running.pop(job)
        self.taken.setdefault(rule, []).append(now - began)

    def left(self, now: float) -> float:
        """Seconds that the other jobs may take on all cores."""
        known = [rule for rule in self.taken if rule in self.expected]
        before = sum(self.expected[rule] * len(self.taken[rule]) for rule in known)
        here = sum(sum(self.taken[rule]) for rule in known)
        scale = (TRUSTED + here) / (TRUSTED + before)
        each = {rule: scale * self.expected.get(rule, SHORT) for rule in self.counts}
        each |= {rule: sum(times) / len(times) for rule, times in self.taken.items()}
        waiting = Counter(self.counts) - Counter({rule: len(times) for rule, times in self.taken.items()})
        seconds = sum(each[rule] * count for rule, count in waiting.items())
        under_way = sum(min(now - began, each.get(rule, SHORT)) for rule, began in self.running.values())
        return max(seconds - under_way, 0.0) / self.cores

    def line(self, now: float) -> str:
        """The line that says it."""
        stages = Counter(rule for rule, _ in self.running.values())
        names = ", ".join(f"{rule} x {count}" if count > 1 else rule for rule, count in stages.items())
        return f"{self.done} of {self.total} jobs done; {names or 'starting'}; about {in_words(self.left(now))} left"


class Console(logging.Handler):
    """Shows the progress of Snakemake's jobs: on a terminal on one line that changes, else on a line now and then."""

    def __init__(self, begin: Callable[[Mapping[str, int]], JobProgress], runs: Callable[[], bool], stream: TextIO):
        """begin: the progress of a run of so many jobs by rule; runs: whether jobs are run, not only listed."""
        super().__init__()
        self.begin, self.runs, self.stream = begin, runs, stream
        self.progress: JobProgress | None = None
        self.changing = stream.isatty() and os.environ.get("TERM") != "dumb"
        self.said, self.drawn = -EVERY, False
        self.logs: dict[int, list[str]] = {}
        self.warnings: list[str] = []

    def filter(self, record: logging.LogRecord) -> bool:
        """Takes what concerns jobs."""
        return getattr(record, "event", None) in ("run_info", "job_info", "job_finished") and self.runs()

    def emit(self, record: logging.LogRecord) -> None:
        now = time.monotonic()
        if record.event == "run_info":
            self.progress = self.begin({rule: count for rule, count in record.stats.items() if rule != "total"})
        elif self.progress is None:
            return
        elif record.event == "job_info":
            self.progress.start(record.jobid, record.rule_name, now)
            self.logs[record.jobid] = list(getattr(record, "log", ()))
            if not record.output:  # a target: its message says where to look
                self.clear()
                self.stream.write(f"{record.rule_msg or record.rule_name}\n")
                self.said = now  # it is the last line, or nearly so
        elif record.job_id in self.progress.running:
            self.progress.end(record.job_id, now)
            for log in self.logs.pop(record.job_id, ()):
                self.warnings = list(dict.fromkeys([*self.warnings, *warnings_in(log)]))
        self.show(now)

    def summary(self) -> None:
        """Show once what stages have warned of."""
        self.clear()
        for words in self.warnings[:MOST]:
            self.stream.write(f"Warning: {words}\n")
        if len(self.warnings) > MOST:
            self.stream.write(f"and {len(self.warnings) - MOST} warnings more, in the logs of the results\n")
        self.warnings = []
        self.stream.flush()

    def show(self, now: float) -> None:
        finished = self.progress.done == self.progress.total
        if self.changing:
            self.clear()
            if not finished:
                width = os.get_terminal_size(self.stream.fileno()).columns
                self.stream.write(self.progress.line(now)[: width - 1])
                self.drawn = True
        elif now - self.said > EVERY and not finished and self.progress.running:
            self.stream.write(self.progress.line(now) + "\n")
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


def quieten(
    logger: logging.Logger, begin: Callable[[Mapping[str, int]], JobProgress], runs: Callable[[], bool]
) -> Console | None:
    """Show progress instead of all that Snakemake says on its console; without a console it is left alone."""
    for handler in logger.handlers:
        if handler.name == "DefaultStreamHandler":
            console = Console(begin, runs, handler.stream)
            handler.addFilter(Quiet(console))
            logger.addHandler(console)
            return console
    return None
