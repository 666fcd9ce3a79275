"""The module of 3D Slicer, without Slicer: the patient's folder, the command, what comes back."""

import json
import subprocess
import sys
from types import SimpleNamespace

import pytest
import SimpleITK as sitk

from pinnochio.plans.plan import Plan
from pinnochio.study.patients import read_patients
from tests.helpers.settings import ROOT

sys.path.insert(0, str(ROOT / "slicer"))
import FacePrediction as module  # noqa: E402


@pytest.fixture
def patient(tmp_path):
    """A folder as the module lays it out; the mandible goes 4 mm back."""
    files = tmp_path / "files"
    files.mkdir()
    for name in ("a.nii.gz", "b.nii.gz", "points.mrk.json"):
        (files / name).touch()
    moved = {}
    for segment, way in (("lefort1", 0.0), ("mandible_distal", 4.0)):
        transform = sitk.AffineTransform(3)  # from the result to the start, as Slicer saves it
        transform.SetTranslation((0, -way, 0))
        moved[segment] = files / f"{segment}.tfm"
        sitk.WriteTransform(transform, str(moved[segment]))
    folder = tmp_path / "P01"
    return (
        module.prepare(folder, files / "a.nii.gz", files / "b.nii.gz", moved, [files / "points.mrk.json"]),
        moved,
        files,
    )


def test_the_folder_is_a_patient_that_the_project_reads(patient):
    folder, moved, files = patient
    read = read_patients(folder)["P01"]
    assert read.segmentation.endswith("segmentation.nii.gz") and read.volume.endswith("volume.nii.gz") and read.markups
    plan = Plan.read(read.plans["slicer"], "P01")
    assert plan.motion("mandible_distal").displacement([[0, 0, 0]])[0].tolist() == pytest.approx([0, 4, 0])
    (folder / "plans/mine.json").write_text("{}")
    (files / "a.seg.nrrd").touch()
    module.prepare(folder, files / "a.seg.nrrd", None, {"chin": None, "lefort1": moved["lefort1"]})
    again = read_patients(folder)["P01"]
    assert not again.volume and not again.markups and set(again.plans) == {"mine", "slicer"}
    assert again.segmentation.endswith("segmentation.seg.nrrd")
    plan = Plan.read(again.plans["slicer"], "P01")
    assert set(plan.motions) == {"chin", "lefort1"} and not plan.motion("chin").displacement([[9, 9, 9]]).any()


def test_names_are_made_safe_and_no_transform_is_refused(tmp_path):
    assert module.patient_name("Doe, J. (2)") == "Doe_J_2"
    with pytest.raises(ValueError, match="letters and digits"):
        module.patient_name("../")
    with pytest.raises(ValueError, match="at least one bone"):
        module.prepare(tmp_path, tmp_path / "a.nii.gz", None, {"lefort1": None})


def test_the_command_is_the_documented_one(patient):
    words = module.command(ROOT, patient[0], "dentalsegmentator", "fem_sliding", "models", 3)
    assert words[1:5] == ["--cores", "3", "predict", "--config"] and words[0].endswith("snakemake")
    config = [f"patient={patient[0]}", "predict={method: fem_sliding}", "labels=dentalsegmentator", "models=models"]
    assert words[5:] == config


def test_results_come_back_and_a_refusal_is_said(patient, tmp_path):
    made = tmp_path / "results/patients/P01/slicer/fem_sliding"

    def good(words, cwd, env, **options):
        assert cwd == tmp_path and env == {"PATH": "/bin"} and words[4] == "--config"
        (made / "bones").mkdir(parents=True)
        for name in ("skin.vtp", "bones/lefort1.stl"):
            (made / name).touch()
        (made / "certificate.json").write_text(json.dumps({"interval": None}))
        return SimpleNamespace(returncode=0, stdout="")

    with pytest.raises(FileNotFoundError, match="no prediction"):
        module.results(tmp_path, "P01", "fem_sliding")
    made = module.predict(tmp_path, patient[0], "dentalsegmentator", "fem_sliding", env={"PATH": "/bin"}, run=good)
    assert made["skin"].is_file() and set(made["bones"]) == {"lefort1"} and made["certificate"] == {"interval": None}

    said = "Traceback\nInputError: case 'P01': a.nii.gz: it is upside\n down. Remedy: set 'orientation'.\nExiting\n"

    def bad(*words, **options):
        return subprocess.CompletedProcess([], 1, said)

    with pytest.raises(RuntimeError, match="^case 'P01': a.nii.gz: it is upside down. Remedy: set 'orientation'.$"):
        module.predict(tmp_path, patient[0], "", "elastic", run=bad)
