"""Files are written as a whole or not at all, and a disk that cannot be written is said."""

import pytest

from pinnochio import files
from pinnochio.beside import second_process
from pinnochio.errors import InputError, StorageError
from pinnochio.files import alone, replacing


@pytest.fixture
def target(tmp_path):
    path = tmp_path / "table.csv"
    path.write_text("old")
    yield path
    assert [path.name for path in tmp_path.iterdir()] == ["table.csv"] and path.read_text() == "old"


def test_a_failed_write_leaves_the_old_file_and_nothing_else(target):
    with pytest.raises(RuntimeError), replacing(target) as temporary:
        temporary.write_text("half")
        raise RuntimeError


@pytest.mark.parametrize("error", [None, RuntimeError("what a library makes of it")])
def test_a_disk_that_fills_up_is_said_whatever_the_writer_says(target, error, monkeypatch):
    said = "table.csv: no space left on device. Remedy: make room"
    with pytest.raises(StorageError, match=said), replacing(target) as temporary:
        temporary.write_text("half")
        monkeypatch.setattr(files, "ROOM", 2**70)
        if error:
            raise error


def test_a_folder_that_cannot_be_made_is_said(target):
    said = "table.csv/a.csv: file exists. Remedy: make its folder writable"
    with pytest.raises(StorageError, match=said), replacing(target / "a.csv"):
        pytest.fail("nothing could be written here")


def enter(folder):
    with alone("P1", folder):
        return True


def test_a_second_run_for_the_same_patient_is_refused_while_the_first_is_at_work(tmp_path):
    with second_process() as other:
        with alone("P1", tmp_path), pytest.raises(InputError, match="'P1': .*: another run .* Remedy: wait until"):
            other.submit(enter, tmp_path).result()
        with pytest.raises(StorageError, match="/proc/P1/.lock: no such file"):
            other.submit(enter, "/proc/P1").result()
        assert other.submit(enter, tmp_path).result()
