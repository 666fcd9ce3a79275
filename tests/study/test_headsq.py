"""The CT headsq, a real head that is not part of the project: thresholds, import, mesh, interfaces, finite elements."""

import json

import meshio
import numpy as np
import pytest

CONFIG = "examples/headsq/config.yaml"


def test_bimaxillary_surgery_of_headsq(headsq):
    small = headsq.folder / "small.yaml"
    small.write_text("mesh: {nodes: 2500}\nfem: {accuracy: exact}\n")
    done = headsq.snakemake("fem", "--configfile", CONFIG, str(small), cores=1)
    assert done.returncode == 0, done.stdout[-4000:]
    case = headsq.folder / "results/headsq/cases/headsq"
    assert json.loads((case / "import.json").read_text())["muscle"] == "derived"
    said = json.loads((case / "fem/mucosa.json").read_text())
    assert said["converged"] and said["relative_residual"] <= 1e-6
    assert said["inverted"] == 0 and said["min_jacobian"] > 0.1
    assert abs(said["nodes"] - 2500) <= 250

    field = meshio.read(case / "fem/mucosa.vtu")
    at, displacement = field.points, field.point_data["displacement"]
    x, y, z = at.T
    # Bone contact goes with its segment: maxilla 4 mm forward (-y), mandible 4 mm back, rami not at all.
    bone = displacement[field.point_data["node_type"] == 2]
    forward, back = (np.abs(bone - [0, step, 0]).max(axis=1) < 1e-9 for step in (-4, 4))
    assert forward.sum() > 20 and back.sum() > 30
    assert np.abs(bone[~forward & ~back]).max() < 1e-9
    # The skin follows: upper lip forward, chin back, brow and ears not. LPS mm, read off the CT.
    middle = np.abs(x - 97) < 15
    lip = middle & (y < 42) & (z > -95) & (z < -78)
    chin = middle & (y < 60) & (z > -128) & (z < -110)
    assert lip.sum() > 5 and displacement[lip, 1].mean() < -2.5
    assert chin.sum() > 5 and displacement[chin, 1].mean() > 2.5
    assert np.linalg.norm(displacement[(z > -25) | (y > 112)], axis=1).mean() < 0.2


@pytest.mark.full
@pytest.mark.parametrize("nodes", [5000, 20000])
def test_finer_meshes_of_headsq_converge(headsq, nodes):
    finer = headsq.folder / "finer.yaml"
    finer.write_text(f"mesh: {{nodes: {nodes}}}\nfem: {{accuracy: exact}}\n")
    made = "results/headsq/cases/headsq/fem/mucosa.json"
    done = headsq.snakemake("--configfile", CONFIG, str(finer), "--", made, cores=1)
    assert done.returncode == 0, done.stdout[-4000:]
    said = json.loads((headsq.folder / made).read_text())
    assert said["converged"] and said["relative_residual"] <= 1e-6 and said["inverted"] == 0
    assert said["min_jacobian"] > 0.1 and abs(said["nodes"] / nodes - 1) < 0.1
