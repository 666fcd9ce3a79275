"""A method that is added as docs/new_method.md says predicts a patient and is measured."""

import h5py
import numpy as np
import pandas as pd

from tests.helpers.documents import named_blocks
from tests.helpers.settings import ROOT
from tests.helpers.study import write_case


def test_a_method_added_as_the_page_says_is_a_row_of_the_table(project):
    blocks = named_blocks(ROOT / "docs/new_method.md")
    added = {path: text for path, text in blocks.items() if not path.endswith(".yaml")}
    assert len(added) == 3
    for path, text in added.items():
        with open(project.folder / path, "a", encoding="utf-8") as file:
            file.write("\n\n" + text)
    study = project.folder / "workflow/pinnochio/study.py"
    study.write_text(study.read_text().replace("UNTRAINED = (", 'UNTRAINED = (\n    "mean_motion",', 1))
    row = write_case(project.folder).replace("P1.ply", "")
    (project.folder / "cases.tsv").write_text("case\tsegmentation\tplan\tpostop\n" + row)
    config = ["cohort=cases.tsv", "methods=[no_change, mean_motion]", "reference=no_change"]
    done = project.snakemake("--config", *config, "--", "results/tables/cases.csv")
    assert done.returncode == 0, done.stdout[-3000:]
    rows = pd.read_csv(project.folder / "results/tables/cases.csv").set_index("method")
    assert set(rows.index) == {"no_change", "mean_motion"} and rows.loc["mean_motion", "min_jacobian"] == 1
    with h5py.File(project.folder / "results/folds/1/mean_motion/predictions.h5") as file:
        field = file["P1/displacement"][:]
    assert np.allclose(field, [0, -5 / 4, 0])  # of the four segments the plan moves one, 5 mm forward
