"""What a run needs is reckoned from its jobs, and a run that does not fit is refused."""

from types import SimpleNamespace

import pytest

from pinnochio.errors import InputError, StorageError
from pinnochio.files import ROOM
from pinnochio.study import needs
from pinnochio.study.needs import at_once, check_needs

JOBS = [("mesh", 1000, 1), ("mesh", 4000, 1), ("mesh", 3000, 1), ("train", 6000, 2), ("train", 6000, 2), ("all", 0, 1)]


@pytest.fixture(autouse=True)
def machine(monkeypatch):
    """A machine of 8 GB with 1 GB free; a mesh leaves 100 MB, and jobs take half of what they ask for."""
    monkeypatch.setattr(needs, "USED", 0.5)
    monkeypatch.setattr(needs, "LEFT", {"mesh": 100.0})
    monkeypatch.setattr(needs, "machine_memory", lambda: 8000.0)
    monkeypatch.setattr(needs.shutil, "disk_usage", lambda folder: SimpleNamespace(free=10**9 + ROOM))


@pytest.mark.parametrize(("cores", "memory"), [(0, 3000), (1, 3000), (2, 3500), (3, 4000), (4, 6000), (64, 6000)])
def test_the_largest_jobs_of_a_rule_run_side_by_side(cores, memory):
    assert at_once(JOBS, cores) == memory and at_once([], cores) == 0


def test_a_run_that_fits_is_said_with_its_needs(tmp_path):
    said = check_needs(JOBS, 4, 15000, tmp_path / "new/results")
    assert said == f"Takes up to 6.0 GB of memory, of 8.0 GB, and 900 MB in {tmp_path}/new/results, of 1.0 GB free."


def test_a_run_that_does_not_fit_is_refused(tmp_path, monkeypatch):
    with pytest.raises(StorageError, match=r"1\.2 GB will be written there, and 1\.0 GB are free\. Nothing"):
        check_needs(JOBS, 4, 20000, tmp_path)
    monkeypatch.setattr(needs, "machine_memory", lambda: 5900.0)
    with pytest.raises(InputError, match=r"6\.0 GB of memory, and there are 5\.9 GB\. .* one job .* takes 3\.0 GB"):
        check_needs(JOBS, 4, 5000, tmp_path)
    assert check_needs(JOBS, 3, 5000, tmp_path)


def test_a_container_counts_by_its_limit(tmp_path, monkeypatch):
    monkeypatch.undo()
    for limit, memory in (("3000000000", 3000), ("max", needs.psutil.virtual_memory().total / 1e6)):
        (tmp_path / "limit").write_text(f"{limit}\n")
        monkeypatch.setattr(needs, "CONTAINER", tmp_path / "limit")
        assert needs.machine_memory() == memory
