"""With every effect of the simulated outcome switched off, perfect finite elements come out perfect."""

import numpy as np
import pytest

from pinnochio.mechanics.elements.tetrahedra import jacobians
from pinnochio.mechanics.simulation import simulate
from pinnochio.model.patient import FREE, PatientModel
from pinnochio.model.truth import read_truth
from pinnochio.plans.plan import Plan
from pinnochio.virtual.aftermath import DECIDED, OPEN
from pinnochio.virtual.ground_truth import EFFECTS, NOMINAL, Dials, resolve
from pinnochio.virtual.outcome import Operation, Outcome, admissible, after, change
from scripts.cohort.carry_truth import carry_truth
from scripts.cohort.virtual_outcome import virtual_outcome
from scripts.patient.choose_samples import choose_samples
from scripts.patient.register_postop import register_postop
from tests.helpers.settings import CONFIG, OUTCOME, SEED
from tests.helpers.training import measured, predict_by


def alone(effects, name):
    """These effects with one on and all others nominal."""
    return resolve(dict.fromkeys(EFFECTS, NOMINAL) | {name: effects[name]})


def inputs_of(patient) -> dict[str, str]:
    """Files of the operation."""
    names = ("segmentation", "landmarks", "anatomy", "covariates")
    return {name: getattr(patient, name) for name in names} | {"plan": patient.input_plan}


@pytest.fixture(scope="module")
def nominal(patient, tmp_path_factory):
    folder = tmp_path_factory.mktemp("nominal")
    made = {"postop": str(folder / "scan.ply"), "truth": str(folder / "truth.h5"),
            "executed": str(folder / "executed.json")}  # fmt: skip
    outcome = OUTCOME | {"effects": "nominal"}
    virtual_outcome(patient.case, inputs_of(patient), outcome, CONFIG["labels"], CONFIG["segments"], SEED, **made)
    return made


@pytest.fixture(scope="module")
def field(patient):
    model = PatientModel.read(patient.model)
    plan = Plan.read(patient.plan, patient.case)
    return model, plan, simulate(model, [plan], patient.fem)[0].displacement


def test_sliding_finite_elements_reproduce_the_truth(patient, nominal, field):
    points, cells, truth, executed = read_truth(nominal["truth"], patient.case)
    model, plan, displacement = field
    assert np.allclose(points, model.points) and np.array_equal(cells, model.cells)
    assert np.linalg.norm(truth, axis=1).max() > 3
    assert np.linalg.norm(displacement - truth, axis=1).max() < 0.01
    for name, move in plan.motions.items():
        assert np.allclose(executed.motion(name).apply(model.points), move.apply(model.points))


def test_the_bounds_of_a_nominal_outcome_are_next_to_nothing(patient, nominal, tmp_path):
    """The true skin misses its noiseless scan by what the registration leaves, and so do finite elements told all."""
    postop, judged = str(tmp_path / "postop.h5"), str(tmp_path / "judged.h5")
    register_postop(patient.case, nominal["postop"], patient.skin, patient.bone, 20.0, 1.0, postop)
    choose_samples(patient.case, patient.model, patient.plan, postop, 3000, SEED, judged)
    motion = str(tmp_path / "true_motion.h5")
    carry_truth(patient.case, nominal["truth"], patient.model, motion)
    rows = {}
    for name, predictor, settings, truths in (
        ("floor_scan", "floor_scan:ScanFloorPredictor", {}, [nominal["truth"]]),
        ("oracle_learner", "oracle_learner:OracleLearnerPredictor", {}, [nominal["truth"]]),
        ("oracle", "finite_elements:FiniteElementPredictor", {"fem": CONFIG["fem"], "contact": "mucosa"}, []),
    ):
        predictions, metrics = str(tmp_path / f"{name}.h5"), str(tmp_path / f"{name}.csv")
        predict_by(predictor, patient, predictions, plan=nominal["executed"], truths=truths, **settings)
        scans = {"postops": {patient.case: postop}, "judged": {patient.case: judged}}
        known = {"plans": [[nominal["executed"]]], "motions": [motion]}
        rows[name] = measured(patient, predictions, metrics, name, **scans, **known).loc[0]
    floor, oracle = rows["floor_scan"], rows["oracle"]
    assert floor["skin_error_p95"] < 1e-4 > floor["landmark_pogonion"] and np.isnan(floor["seconds"])
    # A head of 2 mm voxels and 700 nodes: registration and the way from volume to skin leave a tenth of a millimetre.
    for name in ("oracle", "oracle_learner"):
        assert 0 < floor["cd"] < 0.15 and rows[name]["cd"] == pytest.approx(floor["cd"], abs=0.06)
    # Nothing is random in it, so that a perfect learner knows all of it.
    assert rows["oracle_learner"]["volume_error_p95"] < 1e-4
    assert oracle["moving_error"] < 1e-6 and oracle["sliding_error"] < 1e-6
    assert (floor["target_samples"], floor["skin_samples"]) == (oracle["target_samples"], oracle["skin_samples"])


@pytest.fixture(scope="module")
def operation(patient):
    return Operation.read(patient.case, inputs_of(patient), CONFIG["labels"], CONFIG["segments"], OUTCOME, SEED)


@pytest.fixture(scope="module")
def base(field):
    model, plan, displacement = field
    return Outcome(model, displacement, plan, displacement)


def test_dials_stretch_what_is_open_and_no_published_size(operation, base):
    changes = change(operation, operation.settings.effects, base)
    again = change(operation, operation.settings.effects, base)
    for name in ("sourced", "unsourced", "open"):
        field = getattr(changes, name)
        assert 0.3 < np.linalg.norm(field, axis=1).max() < 12 and np.array_equal(field, getattr(again, name))
    assert np.allclose(changes.decided(Dials(0.5, 9)), 0.5 * (changes.sourced + changes.unsourced))
    assert np.allclose(changes.decided(Dials(2, 9)), changes.sourced + 2 * changes.unsourced)
    assert np.allclose(changes.whole(Dials(2, 3)) - changes.decided(Dials(2, 3)), 3 * changes.open)


def test_what_is_expected_holds_nothing_that_is_open(operation, base):
    changes, dials = change(operation, operation.settings.effects, base), Dials(0.01, 0.02)
    outcome = after(base, changes, dials)
    small = outcome.displacement - base.displacement
    assert np.allclose(outcome.expected - base.displacement, changes.decided(dials), atol=1e-4)
    assert np.allclose(small, changes.whole(dials), atol=1e-4)
    still = after(base, changes, Dials(0, 0))
    assert np.array_equal(still.displacement, base.displacement)


def test_each_change_has_a_switch_that_changes_only_itself(operation, base):
    effects = operation.settings.effects

    def whole(effects):
        return change(operation, effects, base).whole(Dials(1, 1))

    every = whole(effects)
    parts = {name: whole(alone(effects, name)) for name in (*DECIDED, *OPEN)}
    assert all(part.any() for part in parts.values()) and np.allclose(sum(parts.values()), every, atol=1e-6)
    assert np.allclose(every - whole(effects | {"swelling": 0.0}), parts["swelling"], atol=1e-6)


def test_changes_of_the_skin_are_carried_inward_and_leave_the_bone(operation, base):
    model = base.patient
    field = change(operation, alone(operation.settings.effects, "posture"), base).sourced
    assert not field[model.node_type != FREE].any()
    inside = np.setdiff1d(np.flatnonzero(model.node_type == FREE), model.skin_nodes)
    size = np.linalg.norm(field, axis=1)
    assert size[inside].mean() > 0.02 and size[inside].max() < size[np.unique(model.skin_nodes)].max()


def test_a_change_never_turns_an_element_inside_out(field):
    """A field that would crush many elements is damped around them and kept elsewhere."""
    model, _, displacement = field
    wild = np.random.default_rng(0).normal(0, 1.5, displacement.shape)
    before = jacobians(model.points, model.cells, displacement)
    assert (jacobians(model.points, model.cells, displacement + wild) <= 0).sum() > 5
    tamed = admissible(model.points, model.cells, displacement, wild)
    assert (jacobians(model.points, model.cells, displacement + tamed) >= 0.2 * before).all()
    assert (tamed == wild).all(axis=1).mean() > 0.1
    small = 1e-4 * wild
    assert np.array_equal(admissible(model.points, model.cells, displacement, small), small)
