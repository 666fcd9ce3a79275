"""The ArtiSynth face, a real head that is not part of the project: import, mesh, interfaces, finite elements."""

import json

import meshio
import numpy as np
import pandas as pd
import pytest

CONFIG = "examples/artisynth_face/config.yaml"
pytestmark = pytest.mark.full  # of real heads headsq stands in every run, of patients without a scan the stages' tests


def test_setback_of_the_artisynth_mandible(artisynth):
    small = artisynth.folder / "small.yaml"
    small.write_text("mesh:\n  nodes: 2500\n")
    done = artisynth.snakemake("--configfile", CONFIG, str(small))
    assert done.returncode == 0, done.stdout[-4000:]
    case = artisynth.folder / "results/artisynth_face/cases/artisynth"
    said = json.loads((case / "fem/mucosa.json").read_text())
    assert said["converged"] and said["relative_residual"] <= 1e-6
    assert said["inverted"] == 0 and said["min_jacobian"] > 0.1
    field = meshio.read(case / "fem/mucosa.vtu")
    displacement = field.point_data["displacement"]
    moving = field.point_data["node_type"] == 2
    # The mandible goes 5 mm back (+y), the maxilla stays; the chin follows, the brow does not.
    back = displacement[moving]
    assert np.allclose(back[np.linalg.norm(back, axis=1) > 1e-9], [0, 5, 0], atol=1e-9)
    low, high = np.quantile(field.points[:, 2], [0.05, 0.95])
    assert displacement[field.points[:, 2] < low, 1].mean() > 3
    assert np.abs(displacement[field.points[:, 2] > high]).mean() < 0.2
    # Without a scan there is no training and no accuracy; everything else is measured.
    assert "Left out: pinnochio" in done.stdout
    tables = artisynth.folder / "results/artisynth_face/tables"
    rows = pd.read_csv(tables / "cases.csv").set_index("method")
    assert sorted(rows.index) == ["elastic", "fem_bonded", "fem_sliding", "no_change"]
    assert not (tables / "accuracy.csv").exists()
    assert rows["cd"].isna().all() and rows["registration_residual"].isna().all()
    assert (rows["moving_error"].drop("no_change") < 1e-6).all() and rows.loc["no_change", "moving_error"] > 1
    solved = rows.loc[["fem_bonded", "fem_sliding"]]  # a linear field is not in equilibrium, and may turn elements over
    assert (solved["min_jacobian"] > 0.1).all() and (solved["eqres_rel"] < 1e-5).all()
