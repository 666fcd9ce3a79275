"""Lets a study that was killed go on: ends the jobs that it left running and takes its lock away.

python workflow/unlock.py [FOLDER]: the working directory of the study, by default this one. Refused while a Snakemake
that nobody has killed works there.
"""

import os
import shutil
import signal
import sys
import time
from pathlib import Path

SCRIPTS = ".snakemake/scripts/"  # what Snakemake makes of the `script:` of a job
PATIENCE = 10.0  # seconds until a job that does not end is killed


def processes(folder: Path) -> dict[int, list[str]]:
    """Words of the command of each process of this user that works in the folder, by its number."""
    running = {}
    for entry in Path("/proc").glob("[0-9]*"):
        try:
            if entry.stat().st_uid == os.getuid() and Path(os.readlink(entry / "cwd")) == folder:
                words = (entry / "cmdline").read_bytes().decode("utf-8", "replace").split("\0")
                if words != [""]:  # of one that has ended there is none
                    running[int(entry.name)] = words
        except OSError:
            continue  # it has ended, or is another user's
    return running


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
    there = {number: words for number, words in processes(folder).items() if number != os.getpid()}
    if living := [number for number, words in there.items() if of_study(words)]:
        raise SystemExit(f"{folder}: a study is running there (process {living[0]}). Wait for it, or end it (Ctrl-C).")
    orphans = [number for number, words in there.items() if of_job(words)]
    for sign in (signal.SIGTERM, signal.SIGKILL):
        for number in orphans:
            if number in processes(folder):
                os.kill(number, sign)
        end = time.monotonic() + PATIENCE
        while time.monotonic() < end and set(orphans) & processes(folder).keys():
            time.sleep(0.05)
    shutil.rmtree(folder / ".snakemake/locks", ignore_errors=True)
    return orphans


if __name__ == "__main__":
    ended = unlock(Path(*sys.argv[1:2] or "."))
    print(f"The study can go on: start it again. Jobs that were still running and are ended: {len(ended)}.")
