"""Lists the unit tests whose imports meet what has changed since the branch left main, working tree included.

python tests/changed.py PART PARTS: of the files, largest first, every PARTS-th from PART on, so that parts run side by
side. A test that imports nothing that has changed cannot fail for it, unless it reads a file that no import names.
"""

import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "workflow"))

from pinnochio import code  # noqa: E402 - its path stands above

SETTINGS = ROOT / "tests/helpers/settings.py"  # reads the configuration for all others


def git(*words: str) -> list[str]:
    """Lines of what git says in the project, none where it fails."""
    return subprocess.run(["git", *words], cwd=ROOT, capture_output=True, text=True, check=False).stdout.splitlines()


def changed() -> set[Path]:
    """Files that differ from where the branch left main, and those that git does not know yet."""
    base = (git("merge-base", "HEAD", "main") or ["HEAD"])[0]
    names = git("diff", "--name-only", base) + git("ls-files", "--others", "--exclude-standard")
    files = {ROOT / name for name in names}
    return files | {SETTINGS} if any(file.suffix == ".yaml" for file in files) else files


def affected(files: set[Path]) -> list[Path]:
    """Test files of tests/unit whose import closure, with the fixtures above them, meets the files; largest first."""
    code.PACKAGES["tests"] = ROOT / "tests"
    met = []
    for test in (ROOT / "tests/unit").rglob("test_*.py"):
        fixtures = [folder / "conftest.py" for folder in test.parents if (folder / "conftest.py").is_file()]
        if files.intersection(code.closure(test, *fixtures)):
            met.append(test)
    return sorted(met, key=lambda test: (-test.stat().st_size, test))


if __name__ == "__main__":
    part, parts = map(int, sys.argv[1:])
    for test in affected(changed())[part::parts]:
        print(test.relative_to(ROOT))
