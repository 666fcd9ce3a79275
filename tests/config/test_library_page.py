"""The page of the library does what it says, on a small patient in place of the quick study's."""

import shutil
import sys
from dataclasses import replace

import numpy as np

from pinnochio.metrics.judged import choose
from pinnochio.model.postop import PostopSkin
from tests.helpers.documents import FENCE
from tests.helpers.patients import tiny_patient, tiny_plan
from tests.helpers.settings import ROOT, SEED

PAGE = ROOT / "docs/start/library.md"


def test_the_library_in_ten_lines(tmp_path, monkeypatch):
    """A plan is solved and predicted, and the prediction judged against a skin that lies 1 mm beside the solved one."""
    case, patient, plan = tmp_path / "results/quick/cases/V01", tiny_patient(), tiny_plan()
    case.mkdir(parents=True)
    patient.write(case / "model.h5")
    replace(plan, case="V01").write(case / "plan.json")
    (tmp_path / "config").mkdir()
    shutil.copy(ROOT / "config/config.yaml", tmp_path / "config")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", [*sys.path])
    opened, solve, predict, judge = (text for language, text in FENCE.findall(PAGE.read_text()) if language == "python")
    names: dict = {}
    for block in (opened, solve, predict):
        exec(block, names)
    assert names["solved"].converged
    prediction = names["prediction"].displacement
    assert prediction.shape == names["solved"].displacement.shape == patient.points.shape
    assert 0 < np.linalg.norm(prediction - names["solved"].displacement, axis=1).mean() < 0.3  # linear, and not

    skin = patient.moved_skin(prediction) + [0, 0, 1.0]
    PostopSkin(skin, patient.skin_faces, 0.0).write("results/quick/cases/V01/postop.h5")
    choose(patient, plan, skin, patient.skin_faces, 2000, SEED).write("results/quick/cases/V01/judged.h5")
    exec(judge, names)
    assert 0.9 < names["row"]["cd"] < 1.01 and names["row"]["pwr2"] == 100
