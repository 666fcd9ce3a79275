"""Makes the record of what made the results: configuration, versions, code, commit, machine."""

import os
import platform
import subprocess
import sys
from datetime import UTC, datetime
from importlib.metadata import distributions

from pinnochio.code import ROOT, code_hash, stages
from pinnochio.json_text import write_json
from pinnochio.logs import attach_log


def provenance(config: dict, code: str, output: str) -> None:
    """Write the record as JSON; `code` is the content hash of the library."""
    commit = subprocess.run(["git", "-C", ROOT, "rev-parse", "HEAD"], capture_output=True, text=True, check=False)
    changed = subprocess.run(["git", "-C", ROOT, "status", "--porcelain"], capture_output=True, text=True, check=False)
    record = {
        "written": datetime.now(UTC).isoformat(timespec="seconds"),
        "code": code,
        "commit": commit.stdout.strip() or None,
        "uncommitted_changes": bool(changed.stdout.strip()),
        "config": config,
        "python": sys.version.split()[0],
        "packages": {d.metadata["Name"]: d.version for d in sorted(distributions(), key=lambda d: d.name.lower())},
        "machine": {
            "system": platform.platform(),
            "processor": processor(),
            "cores": os.cpu_count(),
            "memory_gib": round(os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") / 2**30, 1),
        },
    }
    write_json(output, record, sort_keys=True)


def processor() -> str:
    """Name of the processor as the system gives it."""
    try:
        with open("/proc/cpuinfo", encoding="utf-8") as file:
            return next(line.split(":")[1].strip() for line in file if line.startswith("model name"))
    except (OSError, StopIteration):
        return platform.processor() or platform.machine()


if __name__ == "__main__":
    attach_log(snakemake.log[0])
    provenance(config=snakemake.config, code=code_hash(*stages()), output=snakemake.output[0])
