"""The stages that measure the simulated outcome of one patient."""

import numpy as np
import pytest

from pinnochio.columns import read_table
from pinnochio.overlays import overlaid
from pinnochio.virtual import learnable, nasolabial, reality, refinement
from pinnochio.virtual.ground_truth import NOMINAL, REALITIES
from scripts.measure_outcome import measure_outcome
from tests.helpers.settings import CONFIG, OUTCOME, SEED, SEGMENTS


@pytest.fixture
def job(patient, tmp_path):
    names = ("segmentation", "landmarks", "anatomy", "covariates")
    return {
        "case": patient.case,
        "inputs": {name: getattr(patient, name) for name in names} | {"plan": patient.input_plan},
        "outcome": OUTCOME,
        "label_values": CONFIG["labels"],
        "segments": SEGMENTS,
        "seed": SEED,
        "arguments": {},
        "table": str(tmp_path / "table.csv"),
    }


def measured(module, job, **own):
    """The table that the module makes."""
    measure_outcome(module=module.__name__, **job | own)
    return read_table(job["table"], module.CASE)


def test_the_deviation_is_measured_by_quarters_of_regions(job, patient):
    rows = measured(learnable, job, arguments={"truth": patient.truth})
    assert len(rows) == 4 * len(learnable.REGIONS) and set(rows["part"]) == {0, 1, 2, 3}
    assert (rows["square"] >= rows["mean"] ** 2 - 1e-9).all() and rows["mean"].abs().max() > 0.1
    assert rows["maxilla"].nunique() == 1


def test_an_advance_of_the_maxilla_closes_the_nasolabial_angle(job):
    row = measured(nasolabial, job).iloc[0]
    assert 70 < row["before"] < 150 and abs(row["after"] - row["before"]) > 0.5


def test_sliding_finite_elements_are_farther_off_at_larger_scales(job, monkeypatch):
    monkeypatch.setattr(reality, "SCALES", (0.0, 2.0))
    own = {"effects": OUTCOME["effects"], "samples": 4000}
    rows = measured(reality, job, arguments=own).set_index(["reality", "scale"])["cd"]
    for name in REALITIES:
        assert rows[name, 2.0] > rows[name, 0.0] + 0.1
    assert rows[NOMINAL, 0.0] < rows["clinic", 2.0]


def test_the_error_of_both_meshes_is_measured(job):
    finer = overlaid(OUTCOME, {"effects": {"nodes": 1500}})
    rows = measured(refinement, job, outcome=finer)
    assert list(rows["mesh"]) == [refinement.METHODS, refinement.OUTCOME]
    assert (rows["mean"] > 0).all() and np.allclose(rows["reference"], 4500, rtol=0.1)
