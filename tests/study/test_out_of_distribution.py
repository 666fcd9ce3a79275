"""Real heads predicted by an archive that was trained on virtual ones: valid, and said to be unlike them."""

import json
import shutil

import pytest

pytestmark = pytest.mark.full


@pytest.mark.parametrize("head", ["artisynth", "headsq"])
def test_a_real_head_is_predicted_and_called_unlike_the_training(request, packed, head):
    project = request.getfixturevalue(head)
    shutil.copytree(packed.folder / "results/quick/archive", project.folder / "models")
    (example,) = (project.folder / "examples").glob(f"{head}*")
    settings = [f"patient={example}/cases.tsv", "models=models", "predict={other_segments: predict}"]
    done = project.snakemake("predict", "--configfile", f"{example}/config.yaml", "--config", *settings)
    assert done.returncode == 0, done.stdout[-4000:]
    (path,) = (project.folder / "results").glob(f"{example.name}/patients/{head}/*/pinnochio_plus/certificate.json")
    said = json.loads(path.read_text())
    assert said["measures"]["inverted"] == 0 and said["measures"]["min_jacobian"] > 0
    assert not said["in_distribution"]["within"] and not said["in_distribution"]["anatomy"]["within"]
    assert (path.parent / "index.html").is_file()
