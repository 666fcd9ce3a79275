"""The CT headsq, a real head that is not part of the project: thresholds, import, mesh, interfaces, finite elements."""

import json
import shlex
import subprocess
import sys
from pathlib import Path

import meshio
import numpy as np
import pytest

CT = Path(__file__).resolve().parents[3] / "shared/data/headsq/headsq_quarter.nrrd"
CONFIG = "examples/headsq/config.yaml"
LABELS = "results/headsq/labels.nii.gz"


def documented_command(config: Path) -> list[str]:
    """The command that the comment at the top of the example gives, with the CT and the Python of this machine."""
    comment = [line[1:] for line in config.read_text(encoding="utf-8").splitlines() if line.startswith("#")]
    start = next(number for number, line in enumerate(comment) if "segment_ct.py" in line)
    text = comment[start].rstrip("\\") + comment[start + 1]
    python, script, ct, labels, *options = shlex.split(text)
    assert (python, Path(ct).name, labels) == ("python", CT.name, LABELS)
    return [sys.executable, script, str(CT), labels, *options]


@pytest.mark.skipif(not CT.is_file(), reason=f"the CT is not at {CT}")
def test_bimaxillary_surgery_of_headsq(project):
    made = subprocess.run(
        documented_command(project.folder / CONFIG), cwd=project.folder, capture_output=True, text=True, check=False
    )
    assert made.returncode == 0, made.stderr
    small = project.folder / "small.yaml"
    small.write_text("mesh:\n  nodes: 2500\n")
    done = project.snakemake("fem", "--configfile", CONFIG, str(small), cores=1)
    assert done.returncode == 0, done.stdout[-4000:]
    case = project.folder / "results/headsq/cases/headsq"
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
