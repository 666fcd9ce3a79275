"""The example patient is predicted by the models that come with the project, without any study."""

import json
import shutil

from tests.helpers.settings import ROOT
from tests.helpers.study import Project, jobs


def test_the_example_patient_is_predicted_right_away(tmp_path):
    project = Project(tmp_path)
    shutil.copytree(ROOT / "models", project.folder / "models")
    done = project.snakemake("predict", "--config", "patient=examples/P01")
    assert done.returncode == 0, done.stdout[-4000:]
    assert "trained on 40 patients (virtual cohort (development))" in done.stdout.split("rule ")[0]
    assert not jobs(done.stdout).keys() & {"pretrain", "finetune", "pack", "virtual_patient"}
    (folder,) = (project.folder / "results/patients/P01").glob("*/pinnochio_plus")
    said = json.loads((folder / "certificate.json").read_text())
    assert said["interval"]["level"] == 0.9 and said["interval"]["patients"] == 40
    assert said["in_distribution"]["within"] and said["measures"]["inverted"] == 0
    assert said["verdict"]["grade"] in ("usable", "with care")
    assert said["measures"]["skin_max_mm"] > 2
    assert 0 < said["measures"]["load_rel"] < 1  # the residual is that of the field under its own load
    assert (folder / "index.html").stat().st_size > 200_000
