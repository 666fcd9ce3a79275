"""docs/how-to/importing.md, typed as the page says in a fresh clone: labels of a free tool, a DICOM series, a plan and
two arches."""

import json
import subprocess
import sys

import numpy as np
import pytest
import yaml

from pinnochio.geometry.rigid import RigidMotion
from pinnochio.plans.plan import Plan
from pinnochio.virtual.head import build_head
from pinnochio.virtual.scanned import sample_patient
from tests.helpers import tools
from tests.helpers.dicom import save_series
from tests.helpers.documents import bash_blocks
from tests.helpers.settings import ROOT

STILL = {"rotation": [[1, 0, 0], [0, 1, 0], [0, 0, 1]], "translation": [0, 0, 0], "pivot": [0, 0, 0]}
ADVANCED = {"lefort1": [0, -4, 0], "mandible_distal": [0, -5, 0]}
BITE = RigidMotion.from_degrees((1, 0, 1), (0.5, 5, 1), (0, -60, -60))  # a setback
(PREDICT,) = bash_blocks(ROOT / "docs/how-to/importing.md")


@pytest.fixture
def clone(tmp_path):
    """A fresh clone of what is committed, with the plan of both jaws that the page names."""
    folder = tmp_path / "pinnochio"
    subprocess.run(["git", "clone", "--quiet", str(ROOT), str(folder)], check=True)
    (folder / ".venv").symlink_to(sys.prefix)
    moved = {name: STILL | {"translation": way} for name, way in ADVANCED.items()}
    segments = moved | {"proximal_left": STILL, "proximal_right": STILL}
    (folder / "advance.json").write_text(json.dumps({"case": "P01", "segments": segments}))
    return folder


def test_a_virtual_head_is_predicted_by_the_commands_of_the_page(clone):
    head = build_head(sample_patient(np.random.default_rng(3), "class_iii"), 3.0)
    tools.write(clone / "segmentation.nii.gz", tools.dental(head), head)
    save_series(clone / "dicom", tools.scan(head), np.eye(3), head.spacing, head.origin)
    tools.save_arches(clone, tools.arches(head, BITE))
    settings = clone / "config/config.yaml"  # so that the commands stay those of the page
    config = yaml.safe_load(settings.read_text(encoding="utf-8"))
    config["mesh"]["nodes"] = 1500  # for speed
    settings.write_text(yaml.safe_dump(config), encoding="utf-8")
    done = subprocess.run(["bash", "-euc", PREDICT], cwd=clone, capture_output=True, text=True, check=False)
    assert done.returncode == 0, (done.stdout + done.stderr)[-4000:]

    home = clone / "results/patients/P01"
    assert (home / "segments.png").stat().st_size > 100_000
    assert (home / "plans_fem_sliding.html").stat().st_size > 100_000
    for name in ("advance", "bite"):
        folder = home / f"{name}/fem_sliding"
        assert (folder / "index.html").stat().st_size > 200_000 and (folder / "skin.stl").stat().st_size > 1000
        measures = json.loads((folder / "certificate.json").read_text())["measures"]
        assert measures["inverted"] == 0 and measures["eqres_rel"] < 0.05  # 0.05 mm from equilibrium
        assert 4 < measures["skin_max_mm"] < 8
        assert measures["min_jacobian"] > 0.1 and 1200 < measures["nodes"] < 1800
    chin = np.argwhere(tools.structures(head)["lower_teeth"]) * head.spacing + head.origin
    off = Plan.read(home / "bite/plan.json", "P01").motion("mandible_distal").apply(chin) - BITE.apply(chin)
    assert np.linalg.norm(off, axis=1).max() < 0.8  # how near from another scan: tests/unit/importing/test_occlusion.py
    imported = json.loads((home / "import.json").read_text())
    assert imported["tool"] == "dentalsegmentator" and set(imported["cuts"]) == {"lefort1", "split_left", "split_right"}
