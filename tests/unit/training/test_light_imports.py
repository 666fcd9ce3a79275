"""Training runs from its HDF5 inputs where only torch, torch_geometric, NumPy, SciPy and h5py are installed."""

import json
import os
import subprocess
import sys
from dataclasses import asdict, replace

import numpy as np
import pytest
import torch

from pinnochio.mechanics.elements.patches import make_patches
from pinnochio.methods.pinnochio.predictor import load_network
from tests.helpers.patients import tiny_patient
from tests.helpers.settings import ROOT
from tests.helpers.training import FEM, PHASES, SMALL, TRAINING, make_cases, run

pytestmark = pytest.mark.full
SHORT = replace(TRAINING, steps=2)
MODEL = tiny_patient(5, (9, 8, 7))
ABSENT = (
    *(
        "numba",
        "triton",
        "llvmlite",
        "SimpleITK",
        "pyvista",
        "igl",
        "vtk",
        "vtkmodules",
        "trimesh",
        "meshio",
        "pandas",
        "pypardiso",
    ),
    *("snakemake", "highdicom", "pydicom", "matplotlib", "jsonschema", "felupe", "pytest"),
)
CHILD = """
import json, sys
from pathlib import Path

absent, inputs, out = json.loads(sys.argv[1]), Path(sys.argv[2]), Path(sys.argv[3])


class Without:
    def __init__(self, finder):
        self.finder = finder

    def find_spec(self, name, *rest):
        return None if name.split(".")[0] in absent else self.finder.find_spec(name, *rest)


sys.meta_path[:] = [Without(finder) for finder in sys.meta_path]

from pinnochio.compiled import COMPILED
from pinnochio.mechanics.elements.tetrahedra import Elements
from pinnochio.mechanics.lift import Lift
from pinnochio.mechanics.elements.patches import make_patches
from pinnochio.methods.pinnochio.learner import GraphLearner
from pinnochio.training.case_files import CaseFiles
from pinnochio.training.device import choose_device
from pinnochio.training.fold import train_fold

assert not COMPILED and not set(absent) & {name.split(".")[0] for name in sys.modules}
settings = {name: json.loads((inputs / f"{name}.json").read_text()) for name in ("network", "fem", "training")}
phases = {"pretraining": settings["training"], "finetuning": settings["training"]}
options, device = {"seed": 3, "code": "code"}, choose_device(0, int(sys.argv[4]))
cases = [CaseFiles(**files) for files in json.loads((inputs / "cases.json").read_text())]
first, last = out / "pretrained.pt", out / "network.pt"
start = None
for phase, name, history in (("pretrain", first, "pretraining.csv"), ("finetune", last, "finetuning.csv")):
    learner = GraphLearner(settings | phases, phase, device)
    train_fold(learner, phase, cases, start, out=name, history=out / history, **options)
    start = name
mesh = json.loads((inputs / "mesh.json").read_text())
print(json.dumps(make_patches(mesh["points"], mesh["cells"], mesh["tissue"]).tolist()))
"""


@pytest.fixture(scope="module")
def light(tmp_path_factory):
    """Folder of both phases, two steps each, done by a Python without the other packages, and patches of a mesh."""
    folder = tmp_path_factory.mktemp("light")
    cases = [{name: value and str(value) for name, value in vars(files).items()} for files in make_cases(folder)]
    mesh = {"points": MODEL.points.tolist(), "cells": MODEL.cells.tolist(), "tissue": MODEL.tissue.tolist()}
    texts = {"network": asdict(SMALL), "fem": FEM, "training": asdict(SHORT), "cases": cases, "mesh": mesh}
    for name, value in texts.items():
        (folder / f"{name}.json").write_text(json.dumps(value))
    arguments = [json.dumps(ABSENT), folder, folder, str(torch.get_num_threads())]
    environment = os.environ | {"PYTHONPATH": str(ROOT / "workflow")}
    process = subprocess.run(
        [sys.executable, "-c", CHILD, *arguments], env=environment, capture_output=True, text=True, timeout=300
    )
    assert process.returncode == 0, process.stderr
    return folder, json.loads(process.stdout.splitlines()[-1])


def test_both_phases_run_without_the_other_packages_to_the_same_weights(light, tmp_path):
    """Up to rounding, since the attention of a CPU is compiled where numba is installed."""
    folder, _ = light
    for phase, (name, _) in PHASES.items():
        run(phase, make_cases(tmp_path), tmp_path, SHORT)
        weights, expected = (load_network(path / name)[0].state_dict() for path in (folder, tmp_path))
        for key, value in weights.items():
            assert torch.allclose(value, expected[key], rtol=1e-3, atol=1e-4), (phase, key)


def test_patches_are_the_same_without_numba(light):
    assert np.array_equal(light[1], make_patches(MODEL.points, MODEL.cells, MODEL.tissue))
    assert max(light[1]) > 100
