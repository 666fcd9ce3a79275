"""The page of the library does what it says, on a small patient in place of the quick study's."""

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np

from pinnochio.metrics.judged import choose
from pinnochio.model.postop import PostopSkin
from tests.helpers.documents import FENCE
from tests.helpers.patients import tiny_patient, tiny_plan
from tests.helpers.settings import ROOT, SEED

PAGE = ROOT / "docs/start/library.md"


def test_the_library_in_ten_lines(tmp_path, monkeypatch):
    """A plan is solved and predicted, and the prediction judged against a skin that lies 1 mm beside the solved one."""
    patient, plan = tiny_patient(), tiny_plan()
    case, new = Path("results/quick/cases/V01"), Path("results/patients/P01")
    monkeypatch.chdir(tmp_path)
    for folder in (case, new / "plan", Path("config")):
        folder.mkdir(parents=True)
    for folder, named, planned in ((case, "V01", case), (new, "P01", new / "plan")):
        patient.write(folder / "model.h5")
        replace(plan, case=named).write(planned / "plan.json")
    shutil.copy(ROOT / "config/config.yaml", "config")
    solve, predict, judge = (text for language, text in FENCE.findall(PAGE.read_text()) if language == "python")
    names: dict = {}
    exec(solve + predict, names)
    assert names["solved"].converged
    prediction = names["prediction"].displacement
    assert prediction.shape == names["solved"].displacement.shape == patient.points.shape
    assert 0 < np.linalg.norm(prediction - names["solved"].displacement, axis=1).mean() < 0.3  # linear, and not

    skin = patient.moved_skin(prediction) + [0, 0, 1.0]
    PostopSkin(skin, patient.skin_faces, 0.0).write(case / "postop.h5")
    choose(patient, plan, skin, patient.skin_faces, 2000, SEED).write(case / "judged.h5")
    exec(judge, names)
    assert 0.9 < names["row"]["cd"] < 1.01 and names["row"]["pwr2"] == 100
