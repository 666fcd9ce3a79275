"""The way of docs/importing.md on a real skull: bones of a free tool, a likely face as the scan, two plans."""

import json
import shutil
import subprocess
import sys

import pytest

from tests.helpers.settings import DATA, ROOT
from tests.helpers.study import Project

SEGMENTATION = DATA / "dentalsegmentator/PostDentalSurgery_Segmentation.nii.gz"
STILL = {"rotation": [[1, 0, 0], [0, 1, 0], [0, 0, 1]], "translation": [0, 0, 0], "pivot": [0, 0, 0]}
PLANS = {"advance": ([0, -4, 0], [0, -5, 0]), "setback": ([0, -3, 1], [0, 5, 0])}


@pytest.mark.full
@pytest.mark.skipif(not SEGMENTATION.is_file(), reason="the real segmentation is not there")
def test_a_real_skull_is_predicted_without_a_hand_made_label(tmp_path):
    project = Project(tmp_path)
    patient = project.folder / "P01"
    (patient / "plans").mkdir(parents=True)
    shutil.copy(SEGMENTATION, patient / "segmentation.nii.gz")
    for name, (upper, lower) in PLANS.items():
        moved = {"lefort1": STILL | {"translation": upper}, "mandible_distal": STILL | {"translation": lower}}
        segments = moved | {"proximal_left": STILL, "proximal_right": STILL}
        (patient / f"plans/{name}.json").write_text(json.dumps({"case": "P01", "segments": segments}))
    words = [sys.executable, str(ROOT / "workflow/fit_face.py"), str(SEGMENTATION), str(patient / "ct.nii.gz")]
    said = subprocess.run(words, cwd=ROOT, capture_output=True, text=True, check=True).stdout
    assert float(said.split()[0]) > 99
    done = project.snakemake(
        "--config", "patient=P01", "labels=dentalsegmentator", "predict={method: fem_sliding}", "--", "predict"
    )
    assert done.returncode == 0, done.stdout[-4000:]
    home = project.folder / "results/patients/P01"
    imported = json.loads((home / "import.json").read_text())
    assert "nothing labelled tells left from right" in imported["frame"]["sides"]
    assert (home / "segments.png").stat().st_size > 100_000
    for name in PLANS:
        measures = json.loads((home / f"{name}/fem_sliding/certificate.json").read_text())["measures"]
        assert measures["min_jacobian"] > 0.4 and measures["inverted"] == 0 and measures["eqres_rel"] < 1e-5
        assert 4.5 < measures["skin_max_mm"] < 6
