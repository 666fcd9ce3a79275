"""The stages that measure the simulated outcome of one patient."""

import numpy as np
import pytest

from pinnochio.columns import read_table
from pinnochio.mechanics.simulation import simulate
from pinnochio.overlays import overlaid
from pinnochio.virtual.ground_truth import CLINIC, NOMINAL, REALITIES, SAME_MODALITY, resolve
from pinnochio.virtual.outcome import Operation, Outcome, meshed
from studies.cohort_checks import reality, refinement, structure
from studies.cohort_checks.measure_outcome import measure_outcome
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


def measured(module, job, **changes):
    """The table that the module makes."""
    measure_outcome(module=module.__name__, **job | changes)
    return read_table(job["table"], module.CASE)


@pytest.mark.full
def test_the_deviation_is_that_of_the_outcome_from_sliding_finite_elements(job, patient, tmp_path):
    """An outcome that is their field, shifted, of which a part is expected."""
    outcome = overlaid(OUTCOME, {"effects": {"expression": 0}})
    operation = Operation.read(
        **{name: job[name] for name in ("case", "inputs", "segments", "seed")}, labels=CONFIG["labels"], outcome=outcome
    )
    model = meshed(operation, resolve(NOMINAL))
    field = simulate(model, [operation.plan], operation.settings.fem)[0].displacement

    def deviation(forward, expected):
        truth = tmp_path / "truth.h5"
        Outcome(model, field + [0, -forward, 0], operation.plan, field + [0, -expected, 0]).write(truth)
        return measured(structure, job, outcome=outcome, arguments={"truth": str(truth), "template": patient.model})

    still, ahead, known = deviation(0.0, 0.0), deviation(0.8, 0.0), deviation(0.8, 0.6)
    assert len(ahead) == structure.PLACES and ahead["square"].nunique() == 1
    assert still["deviation"].abs().median() < 0.01
    assert 0.1 < (ahead["deviation"] - still["deviation"]).median() <= 0.8
    one, other = ahead.iloc[0], known.iloc[0]
    assert 0 < one["left"] <= one["square"] + 1e-6 < 0.64 and one["rms"] < 0.8
    assert other["left"] == pytest.approx(one["left"] * (0.2 / 0.8) ** 2, rel=0.05)
    assert one["fine_band"] < 0.12 and one["symmetric"] > 0.85  # of a shift, which is rigid


@pytest.mark.full
@pytest.mark.parametrize("name", [CLINIC, SAME_MODALITY])
def test_dials_make_finite_elements_err_more_and_a_perfect_learner_nearer(job, monkeypatch, name):
    monkeypatch.setattr(reality, "REALITIES", {name: REALITIES[name]})
    monkeypatch.setattr(reality, "DECIDED", (0.0, 2.0))
    monkeypatch.setattr(reality, "OPEN", {name: (0.0, 1.0)})
    arguments = {"effects": OUTCOME["effects"], "samples": 4000}
    rows = measured(reality, job, arguments=arguments).set_index(["reality", "decided", "open"]).loc[name]
    plain, decided, opened = (rows.loc[dials] for dials in ((0.0, 0.0), (2.0, 0.0), (0.0, 1.0)))
    assert decided["cd"] > plain["cd"] + 0.1 and opened["cd"] > plain["cd"] + 0.05
    # What is decided is known to a perfect learner, what is open is not; nobody is better than the floor.
    assert decided["cd_learner"] < decided["cd"] - 0.1
    assert opened["cd_learner"] > plain["cd_learner"] + 0.05
    assert (rows["cd_floor"] <= rows["cd_learner"] + 0.05).all()


@pytest.mark.full
def test_a_finer_mesh_has_the_smaller_error(job):
    """Both far below the motion of 5 mm, and neither zero, which the same mesh twice would give."""
    rows = measured(refinement, job, outcome=overlaid(OUTCOME, {"effects": {"nodes": 1500}})).set_index("mesh")
    assert list(rows.index) == [refinement.METHODS, refinement.OUTCOME]
    assert np.allclose(rows["nodes"], [700, 1500], rtol=0.1) and np.allclose(rows["reference"], 4500, rtol=0.1)
    assert 0.1 < rows.loc[refinement.OUTCOME, "mean"] < 0.95 * rows.loc[refinement.METHODS, "mean"] < 1.0
    assert (rows["p95"] > 2 * rows["mean"]).all()
