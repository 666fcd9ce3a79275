"""Trainings side by side take one GPU after the other."""

from pinnochio.training import device


def test_the_gpu_that_fewest_have_taken_is_next_until_its_process_ends(tmp_path, monkeypatch):
    monkeypatch.setattr(device.tempfile, "gettempdir", lambda: str(tmp_path))
    monkeypatch.setattr(device, "_TAKEN", taken := [])
    assert [device.least_used(2) for _ in range(5)] == [0, 1, 0, 1, 0]
    taken[1].close()
    assert [device.least_used(2) for _ in range(2)] == [1, 1]
