"""docs/how-to/importing.md, typed as the page says: segmentation of a free tool, scan, two plans, two faces."""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import yaml

from pinnochio.virtual.head import build_head
from pinnochio.virtual.scanned import sample_patient
from tests.helpers import tools
from tests.helpers.documents import bash_blocks
from tests.helpers.settings import DATA, ROOT
from tests.helpers.study import Project

SEGMENTATION = DATA / "dentalsegmentator/PostDentalSurgery_Segmentation.nii.gz"
STILL = {"rotation": [[1, 0, 0], [0, 1, 0], [0, 0, 1]], "translation": [0, 0, 0], "pivot": [0, 0, 0]}
PLANS = {"advance": ([0, -4, 0], [0, -5, 0]), "setback": ([0, -3, 1], [0, 5, 0])}
PREDICT, FIT = bash_blocks(ROOT / "docs/how-to/importing.md")


@pytest.fixture
def project(tmp_path):
    """A copy of the project beside the real heads, with the plans of both jaws that the page names."""
    (tmp_path / "project").mkdir()
    (tmp_path / "shared").symlink_to(DATA.parent)
    project = Project(tmp_path / "project")
    for name, (upper, lower) in PLANS.items():
        moved = {"lefort1": STILL | {"translation": upper}, "mandible_distal": STILL | {"translation": lower}}
        segments = moved | {"proximal_left": STILL, "proximal_right": STILL}
        (project.folder / f"{name}.json").write_text(json.dumps({"case": "P01", "segments": segments}))
    return project


def mesh_of(project, nodes):
    """Set the project's own number of nodes, so that the commands stay those of the page."""
    settings = project.folder / "config/config.yaml"
    config = yaml.safe_load(settings.read_text(encoding="utf-8"))
    config["mesh"]["nodes"] = nodes
    settings.write_text(yaml.safe_dump(config), encoding="utf-8")


def typed(block, project):
    """What a shell says to a block of the page, typed in the project with its environment active."""
    path = os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])
    done = subprocess.run(
        ["bash", "-euc", block],
        cwd=project.folder,
        env=os.environ | {"PATH": path},
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout[-4000:]
    return done.stdout


def predicted(project):
    """The import's report, and the measures of each plan; every page and picture of the patient is there."""
    home = project.folder / "results/patients/P01"
    assert (home / "segments.png").stat().st_size > 100_000
    assert (home / "plans_fem_sliding.html").stat().st_size > 100_000
    said = {}
    for name in PLANS:
        folder = home / f"{name}/fem_sliding"
        assert (folder / "index.html").stat().st_size > 200_000 and (folder / "skin.stl").stat().st_size > 1000
        said[name] = json.loads((folder / "certificate.json").read_text())["measures"]
        assert said[name]["inverted"] == 0 and said[name]["eqres_rel"] < 0.05  # 0.05 mm from equilibrium
        assert 4 < said[name]["skin_max_mm"] < 6
    return json.loads((home / "import.json").read_text()), said


def test_a_virtual_head_is_predicted_by_the_commands_of_the_page(project):
    head = build_head(sample_patient(np.random.default_rng(3), "class_iii"), 3.0)
    tools.write(project.folder / "segmentation.nii.gz", tools.dental(head), head)
    tools.write(project.folder / "ct.nii.gz", tools.scan(head), head)
    mesh_of(project, 1500)  # for speed
    typed(PREDICT, project)
    imported, measures = predicted(project)
    assert imported["tool"] == "dentalsegmentator" and set(imported["cuts"]) == {"lefort1", "split_left", "split_right"}
    assert all(measure["min_jacobian"] > 0.1 and 1200 < measure["nodes"] < 1800 for measure in measures.values())


@pytest.mark.full
@pytest.mark.skipif(not SEGMENTATION.is_file(), reason="the real segmentation is not there")
@pytest.mark.parametrize(("nodes", "least", "detail"), [(5000, 0.4, False), (20000, 0.05, True)])
def test_a_real_skull_is_predicted_without_a_hand_made_label(project, nodes, least, detail):
    mesh_of(project, nodes)
    (project.folder / "P01").mkdir()
    assert float(typed(FIT, project).split()[0]) > 99
    (project.folder / "P01/ct.nii.gz").rename(project.folder / "ct.nii.gz")
    shutil.copy(SEGMENTATION, project.folder / "segmentation.nii.gz")
    typed(PREDICT, project)
    imported, measures = predicted(project)
    assert "nothing labelled tells left from right" in imported["frame"]["sides"]
    for measure in measures.values():
        assert measure["min_jacobian"] > least and abs(measure["nodes"] / nodes - 1) < 0.1
        assert (measure["off_mesh_p95_mm"] < 1) == detail  # the coarser mesh lacks the form of the lips
