"""Stages of one job: what is made again, and what a killed job leaves to the next."""

import logging
import os
import shutil
from pathlib import Path

import pytest

from pinnochio.code import code_hash, source_file
from pinnochio.stages import Stages


def join(words: list[str], after: str, text: str, between: str) -> None:
    """A stage: files joined, with `after` at the end."""
    logging.info("joined")
    Path(text).write_text(between.join([*(Path(word).read_text() for word in words), Path(after).read_text()]))


@pytest.fixture
def run(tmp_path, caplog):
    """Runs the stage in a new job; whether it was made again."""
    for name in ("one", "two", "end"):
        (tmp_path / name).write_text(name)
    caplog.set_level(logging.INFO)

    def run(between="-", text="text"):
        caplog.clear()
        words, output = [str(tmp_path / name) for name in ("one", "two")], {"text": str(tmp_path / text)}
        inputs = {"words": words, "after": str(tmp_path / "end")}
        Stages(tmp_path / ".made.json")(join, inputs, output, {"between": between})
        return "joined" in caplog.text

    return run


def test_content_settings_and_lost_outputs_count_not_times(run, tmp_path):
    run()
    (tmp_path / "two").write_text("2")
    assert run() and (tmp_path / "text").read_text() == "one-2-end" and run("+") and not run("+")
    (tmp_path / "text").unlink()
    assert run("+")
    (tmp_path / "text").write_text("an older one, put back")
    assert run("+")
    os.utime(tmp_path / "one", (1e9, 2e9))
    assert not run("+")


def test_a_stage_that_makes_several_files_in_turn_keeps_each(run):
    assert run() and run(text="other") and not run() and not run(text="other")


def test_an_edit_of_what_the_settings_call_by_name_counts(run, monkeypatch):
    method, module = "pinnochio.methods.elastic:ElasticPredictor", source_file("pinnochio.methods.elastic")
    assert run(method) and run("-", "other")
    monkeypatch.setattr("pinnochio.stages.code_hash", lambda *files: code_hash(*files) + "edited" * (module in files))
    assert run(method) and not run("-", "other")


def test_what_stays_counts_as_new(run, tmp_path):
    run()
    os.utime(tmp_path / "text", (1e9, 1e9))
    assert not run() and (tmp_path / "text").stat().st_mtime > 1.5e9


def test_a_stage_that_fails_is_run_again_and_those_before_it_are_not(run, tmp_path):
    run()
    for _ in range(2):
        with pytest.raises(ZeroDivisionError), Stages(tmp_path / ".made.json") as stages:
            stages(lambda: 1 / 0, {}, {}, {})
    assert not run()


def several(folder: str, table: str) -> None:
    """A stage that makes a folder and a file."""
    logging.info("made")
    Path(folder).mkdir(exist_ok=True)
    (Path(folder) / "bone").write_text("bone")
    Path(table).write_text("table")


@pytest.mark.parametrize("older", [False, True])
def test_what_snakemake_deletes_or_replaces_after_an_error_is_taken_from_copies(tmp_path, caplog, older):
    caplog.set_level(logging.INFO)
    outputs = {"folder": str(tmp_path / "bones"), "table": str(tmp_path / "table.csv")}

    def job(fails: bool) -> int:
        caplog.clear()
        with Stages(tmp_path / ".made.json") as stages:
            stages(several, {}, outputs, {})
            if fails:
                raise MemoryError
        return caplog.text.count("made\n")

    with pytest.raises(MemoryError):
        job(fails=True)
    shutil.rmtree(tmp_path / "bones")
    (tmp_path / "table.csv").unlink()
    if older:
        (tmp_path / "table.csv").write_text("an older one")
    assert job(fails=False) == 0
    assert (tmp_path / "bones/bone").read_text() == "bone" and (tmp_path / "table.csv").read_text() == "table"
    assert {path.name for path in tmp_path.iterdir()} == {".made.json", "bones", "table.csv"}  # the copies are gone
