"""Makes the record of what made the results: configuration, versions, code, commit, machine."""

import json
import os
import platform
import subprocess
import sys
from datetime import UTC, datetime
from importlib.metadata import distributions

from pinnochio.code import ROOT, code_hash, stages
from pinnochio.files import replacing
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
    with replacing(output) as temporary:
        temporary.write_text(json.dumps(record, indent=1, sort_keys=True) + "\n", encoding="utf-8")


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
