"""A method added as docs/how-to/new_method.md says: it predicts a patient and reruns nothing of another method."""

import re

import h5py
import numpy as np
import pandas as pd
import pytest

from tests.helpers.documents import named_blocks
from tests.helpers.settings import ROOT
from tests.helpers.study import jobs, made_tables, write_case

REGISTRY, SCHEMA = "workflow/pinnochio/methods/registry.py", "workflow/schemas/config.schema.yaml"
PLACES = {  # what the page adds to a file stands after this line there, and at the end of any other
    REGISTRY: "BUILT_IN = (\n",
    SCHEMA: "\nproperties:\n",
}


def add_method(project) -> dict:
    """Do all steps of the page; the files as they were, None for those that were not there."""
    before = {}
    for name, text in named_blocks(ROOT / "docs/how-to/new_method.md").items():
        path = project.folder / name
        if path.name == "wide.yaml":  # of another way, by configuration alone
            continue
        before[path] = path.read_text(encoding="utf-8") if path.exists() else None
        head, place, rest = (before[path] or "").partition(PLACES.get(name, "\0"))
        path.write_text(head + place + text + rest if place else head + text, encoding="utf-8")
    for path, one, other in (
        (project.folder / SCHEMA, "required: [", "required: [mean_motion, "),
        *(
            (project.folder / f"config/{name}.yaml", "\nmethods: [", "\nmethods: [mean_motion, ")
            for name in ("config", "quick")
        ),
    ):
        before.setdefault(path, path.read_text(encoding="utf-8"))
        path.write_text(path.read_text(encoding="utf-8").replace(one, other, 1), encoding="utf-8")
    return before


@pytest.fixture
def added(studied):
    """The finished quick study with the method added, and afterwards as it was."""
    before = add_method(studied)
    yield studied
    for path, text in before.items():
        path.unlink() if text is None else path.write_text(text, encoding="utf-8")


def test_a_further_method_reruns_nothing_of_the_others(added):
    said = added.quick("--dry-run")
    made = jobs(said)
    assert made.pop("predict_both_motions") == 2  # of each fold
    assert made.keys() == {"tabulate", "provenance", "all"}
    predicted = {f"fold {fold} by mean_motion" for fold in "12"}
    assert set(re.findall(r"Predict (.*) from both motions, and judge it", said)) == predicted
    # Tables of what is measured of every method; nothing that one method's training or patients' meshes decide.
    assert made_tables(said) <= {"cases", "accuracy", "regions", "landmarks", "planned", "stages"}


def test_a_method_added_as_the_page_says_is_a_row_of_the_table(project):
    add_method(project)
    row = write_case(project.folder).replace("P1.ply", "")
    (project.folder / "cases.tsv").write_text("case\tsegmentation\tplan\tpostop\n" + row)
    config = ["cohort=cases.tsv", "methods=[no_change, mean_motion]", "reference=no_change", "mesh={nodes: 800}"]
    done = project.snakemake("--config", *config, "mean_motion={share: 0.5}", "--", "results/tables/cases.csv")
    assert done.returncode == 0, done.stdout[-3000:]
    rows = pd.read_csv(project.folder / "results/tables/cases.csv").set_index("method")
    assert set(rows.index) == {"no_change", "mean_motion"} and rows.loc["mean_motion", "min_jacobian"] == 1
    with h5py.File(project.folder / "results/folds/1/mean_motion/predictions.h5") as file:
        field = file["P1/displacement"][:]
    assert np.allclose(field, [0, -0.5 * 5 / 4, 0])  # of the four segments the plan moves one, 5 mm forward
