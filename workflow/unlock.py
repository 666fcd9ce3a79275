"""Lets a study that was killed go on: ends the jobs that it left running and takes its lock away.

python workflow/unlock.py [FOLDER]: the working directory of the study, by default this one. Refused while a Snakemake
that nobody has killed works there.
"""

import os
import shutil
import sys
from contextlib import suppress
from pathlib import Path

import psutil

SCRIPTS = ".snakemake/scripts/"  # what Snakemake makes of the `script:` of a job
PATIENCE = 10.0  # seconds until a job that does not end is killed


def processes(folder: Path) -> dict[psutil.Process, list[str]]:
    """Words of the command of each process that works in the folder, as far as this user may know."""
    running = {process: process.info for process in psutil.process_iter(["cwd", "cmdline"])}
    return {process: info["cmdline"] for process, info in running.items() if info["cwd"] == str(folder)}


def of_study(words: list[str]) -> bool:
    """Whether the process is a Snakemake that a person or a script has started, no part of one."""
    called = any(Path(word).name == "snakemake" for word in words[:3])
    return called and "--mode" not in words


def of_job(words: list[str]) -> bool:
    """Whether the process is a job, or the part of Snakemake that runs it."""
    return any(SCRIPTS in word for word in words) or ("--mode" in words and "snakemake" in " ".join(words[:3]))


def unlock(folder: Path) -> list[int]:
    """End the jobs of the folder that no study is waiting for, and remove its locks; the numbers of these processes."""
    folder = folder.resolve()
    there = {process: words for process, words in processes(folder).items() if words and process.pid != os.getpid()}
    if living := [process.pid for process, words in there.items() if of_study(words)]:
        raise SystemExit(f"{folder}: a study is running there (process {living[0]}). Wait for it, or end it (Ctrl-C).")
    orphans = [process for process, words in there.items() if of_job(words)]
    left = orphans
    for end in (psutil.Process.terminate, psutil.Process.kill):
        for process in left:
            with suppress(psutil.NoSuchProcess):
                end(process)
        left = psutil.wait_procs(left, PATIENCE)[1]
    shutil.rmtree(folder / ".snakemake/locks", ignore_errors=True)
    return [process.pid for process in orphans]


if __name__ == "__main__":
    ended = unlock(Path(*sys.argv[1:2] or "."))
    print(f"The study can go on: start it again. Jobs that were still running and are ended: {len(ended)}.")
