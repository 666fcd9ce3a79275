"""The stages around the achieved motion, on the files of one coarse virtual patient."""

import json
from pathlib import Path

import pytest

from pinnochio.columns import read_table
from pinnochio.errors import InputError
from pinnochio.importing.segment_registration import FITS
from pinnochio.model.surfaces import BoneSurface
from pinnochio.plans.plan import Plan
from pinnochio.tables.segments import motion_errors
from scripts.cohort.virtual_postop_bones import virtual_postop_bones
from scripts.patient.import_covariates import import_covariates
from scripts.patient.register_segments import register_segments
from tests.helpers.settings import CONFIG, SEED, SEGMENTS


@pytest.fixture(scope="module")
def bones(patient, tmp_path_factory) -> str:
    """The scanned bones."""
    file = str(tmp_path_factory.mktemp("bones") / "T0.nii.gz")
    files = patient.segmentation, patient.executed
    virtual_postop_bones(patient.case, *files, CONFIG["labels"], CONFIG["segments"], 1.0, SEED, file)
    return file


def register(patient, bones, folder, limit=0.45) -> list[Path]:
    files = [folder / name for name in ("achieved.json", "segments.csv")]
    before = patient.labels, patient.bone, patient.plan
    register_segments(patient.case, bones, *before, limit, 70.0, *map(str, files))
    return files


def test_the_achieved_motion_is_the_executed_one_not_the_plan(patient, bones, tmp_path):
    achieved, fits = register(patient, bones, tmp_path)
    plan = Plan.read(achieved, patient.case)
    assert set(plan.motions) == set(SEGMENTS)
    surface, true = BoneSurface.read(patient.bone), Plan.read(patient.executed, patient.case)
    planned = motion_errors(Plan.read(patient.plan, patient.case), true, surface)
    errors = motion_errors(plan, true, surface)
    for name, fit in errors.items():
        assert fit["error_mean"] < 0.6 and fit["error_degrees"] < 1.5, (name, fit)
    assert sum(fit["error_mean"] for fit in errors.values()) < 0.4 * sum(fit["error_mean"] for fit in planned.values())
    rows = read_table(fits, FITS)
    assert rows["segment"].tolist() == ["cranium", *SEGMENTS] and (rows["case"] == patient.case).all()
    assert rows["median"].between(0.05, 0.5).all() and (rows["matched"] > 60).all()


def test_the_same_seed_scans_the_same_bones(patient, bones, tmp_path):
    again = tmp_path / "again.nii.gz"
    rest = patient.segmentation, patient.executed, CONFIG["labels"], CONFIG["segments"], 1.0
    virtual_postop_bones(patient.case, *rest, SEED, str(again))
    assert again.read_bytes() == Path(bones).read_bytes()
    virtual_postop_bones(patient.case, *rest, SEED + 1, str(again))
    assert again.read_bytes() != Path(bones).read_bytes()


def test_bones_that_do_not_fit_are_refused_and_leave_no_file(patient, bones, tmp_path):
    with pytest.raises(InputError, match=rf"'{patient.case}'.*T0.nii.gz.*median distance of .*limit 0.01 mm.*Remedy"):
        register(patient, bones, tmp_path, limit=0.01)
    assert list(tmp_path.iterdir()) == []


def test_covariates_come_from_the_table_or_from_a_file(tmp_path):
    source, out = tmp_path / "source.json", tmp_path / "covariates.json"
    source.write_text(json.dumps({"sex": "male", "cinch": True, "other": 1}))
    empty = dict.fromkeys(("sex", "age", "bmi", "months", "closure", "cinch"))
    for known, file, expected in (
        ({"age": 31.0}, None, empty | {"age": 31.0}),
        ({}, None, empty),
        (None, str(source), empty | {"sex": "male", "cinch": True}),
    ):
        import_covariates(known, file, str(out))
        assert json.loads(out.read_text()) == expected
