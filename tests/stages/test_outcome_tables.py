"""The stages that measure the simulated outcome of one patient."""

import numpy as np
import pytest

from pinnochio.columns import read_table
from pinnochio.mechanics.simulation import simulate
from pinnochio.overlays import overlaid
from pinnochio.virtual import effects, nasolabial
from pinnochio.virtual.effects import EVERYTHING, NOTHING
from pinnochio.virtual.ground_truth import EFFECTS, NOMINAL, REALITIES, resolve
from pinnochio.virtual.outcome import Operation, Outcome, meshed
from scripts.cohort.measure_outcome import measure_outcome
from studies.cohort_checks import learnable, reality, refinement
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


def test_the_deviation_is_that_of_the_outcome_from_sliding_finite_elements(job, tmp_path):
    """An outcome that is their field, shifted: nothing deviates without a shift, and then the normals' share of it."""
    outcome = overlaid(OUTCOME, {"effects": {"expression": 0}})
    operation = Operation.read(
        **{name: job[name] for name in ("case", "inputs", "segments", "seed")}, labels=CONFIG["labels"], outcome=outcome
    )
    patient = meshed(operation, resolve(NOMINAL))
    field = simulate(patient, [operation.plan], operation.settings.fem)[0].displacement

    def deviation(forward):
        truth = tmp_path / "truth.h5"
        Outcome(patient, field + [0, -forward, 0], operation.plan).write(truth)
        return measured(learnable, job, outcome=outcome, arguments={"truth": str(truth)})

    still, ahead, behind = map(deviation, (0.0, 0.8, -0.8))
    assert len(ahead) == 4 * len(learnable.REGIONS) and set(ahead["part"]) == {0, 1, 2, 3}
    assert still["mean"].abs().median() < 0.01 and still["mean"].abs().max() < 0.6  # where closed lips are interpolated
    share = ahead["mean"] - still["mean"]
    assert share.between(0.04, 0.8).all() and share[ahead["region"] == "chin"].min() > 0.4
    np.testing.assert_allclose(behind["mean"] - still["mean"], -share, atol=3e-5)
    assert (ahead["square"] >= ahead["mean"] ** 2 - 1e-4).all()
    assert ((ahead["square"] + behind["square"]) / 2 - still["square"] <= 0.64 + 1e-4).all()
    assert ahead["maxilla"].nunique() == 1


def test_an_effect_of_each_kind_changes_the_face_or_its_scan(job, patient):
    """Alone: of mechanics, motion, tissue and scan; that of the frame is taken out by the registration."""
    on = ("posture", "execution_error", "gain", "noise", "holes", "frame")
    off = {"effects": {name: "nominal" for name in EFFECTS if name not in on}}
    arguments = {"truth": patient.truth}
    rows = measured(effects, job, outcome=overlaid(OUTCOME, off), arguments=arguments).set_index("effect")
    assert set(rows.index) == {NOTHING, *on, EVERYTHING}
    nothing, far = rows.loc[NOTHING], rows["mean"]
    assert nothing["mean"] < 0.1 and nothing["lost"] < 1
    assert (far[["posture", "execution_error", "gain"]] > 0.005).all() and far["noise"] > nothing["mean"] + 0.05
    assert rows.loc["holes", "lost"] > nothing["lost"] + 0.1 and abs(far["frame"] - nothing["mean"]) < 0.05
    assert far[EVERYTHING] > 0.5 * far[["posture", "execution_error", "gain"]].max()


def test_an_advance_of_the_maxilla_opens_the_nasolabial_angle_and_a_setback_closes_it(job, monkeypatch):
    """The columella goes along less than the lip's base: 7.5 degrees on this head, 6.6 on the study's [X]."""
    row = measured(nasolabial, job).iloc[0]
    change = row["after"] - row["before"]
    assert row["before"] == pytest.approx(118, abs=2) and change == pytest.approx(7.5, abs=1.5)
    for advance, low, high in ((0.0, -1e-6, 1e-6), (-nasolabial.ADVANCE, -1.7 * change, -0.4 * change)):
        monkeypatch.setattr(nasolabial, "ADVANCE", advance)
        row = measured(nasolabial, job).iloc[0]
        assert low <= row["after"] - row["before"] <= high


def test_sliding_finite_elements_are_farther_off_at_larger_scales(job, monkeypatch):
    monkeypatch.setattr(reality, "SCALES", (0.0, 2.0))
    arguments = {"effects": OUTCOME["effects"], "samples": 4000}
    rows = measured(reality, job, arguments=arguments).set_index(["reality", "scale"])["cd"]
    for name in REALITIES:
        assert rows[name, 2.0] > rows[name, 0.0] + 0.1
    assert rows[NOMINAL, 0.0] < rows["clinic", 2.0]


def test_a_finer_mesh_has_the_smaller_error(job):
    """Both far below the motion of 5 mm, and neither zero, which the same mesh twice would give."""
    rows = measured(refinement, job, outcome=overlaid(OUTCOME, {"effects": {"nodes": 1500}})).set_index("mesh")
    assert list(rows.index) == [refinement.METHODS, refinement.OUTCOME]
    assert np.allclose(rows["nodes"], [700, 1500], rtol=0.1) and np.allclose(rows["reference"], 4500, rtol=0.1)
    assert 0.1 < rows.loc[refinement.OUTCOME, "mean"] < 0.9 * rows.loc[refinement.METHODS, "mean"] < 0.5
    assert (rows["p95"] > 2 * rows["mean"]).all()
