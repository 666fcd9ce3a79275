import numpy as np
import pandas as pd
import pytest

from pinnochio.columns import check, write_csv
from pinnochio.geometry.rigid import RigidMotion
from pinnochio.methods.registry import graph_networks, registry
from pinnochio.metrics.judged import choose
from pinnochio.model.predictions import Prediction, read_prediction, write_predictions
from pinnochio.plans.plan import Plan
from pinnochio.study.study import Study
from studies.tradeoff.cases import TRADEOFF_CASES
from studies.tradeoff.figure import draw
from studies.tradeoff.inputs import Tradeoff
from studies.tradeoff.measuring import Reference, judge, predict_fem
from studies.tradeoff.settings import BASE, VARIED, Setting, fem_settings, network_settings
from studies.tradeoff.table import answers, pareto, summarise
from tests.helpers import settings
from tests.helpers.patients import tiny_patient
from tests.helpers.settings import CONFIG
from tests.helpers.tables import make, texts

# method, value, seconds, cd, face error
SETTINGS = (
    ("fast", "1", 0.01, 0.9, 0.5),
    ("middle", "1", 0.2, 0.7, 0.2),
    ("middle", "2", 0.5, 0.65, 0.1),
    ("bad", "1", 0.6, 0.8, 0.3),
    ("slow", "1", 8.0, 0.6, 0.0),
)


def rows(factors=None) -> pd.DataFrame:
    """Rows of TRADEOFF_CASES: SETTINGS on patients whose seconds and errors are multiples."""
    cells = []
    for case, (time, error) in (factors or {"A": (1, 1), "B": (1.1, 0.9), "C": (0.9, 1.1)}).items():
        for method, value, seconds, cd, face in SETTINGS:
            row = {"case": case, "method": method, "parameter": "turn", "value": value, "nodes": 100}
            row |= {"seconds": seconds * time, "setup_seconds": 0, "threads": 1, "converged": True, "cd": cd * error}
            row |= {"face_error": face * error, "face_error_max": 3 * face, "volume_error": face, "eqres_rel": 0.1}
            cells.append(row | {"min_jacobian": 0.5, "inverted": 0})
    return pd.DataFrame(cells)


def test_the_front_is_what_comparing_all_pairs_leaves():
    rng = np.random.default_rng(3)
    seconds = rng.integers(1, 30, 200).astype(float)
    errors = 30 - seconds + rng.integers(0, 12, 200)
    errors[::17] = np.nan
    optimal = pareto(seconds, errors)
    for i in range(len(seconds)):
        beaten = (seconds <= seconds[i]) & (errors <= errors[i]) & ((seconds < seconds[i]) | (errors < errors[i]))
        twin = (seconds == seconds[i]) & (errors == errors[i]) & (np.arange(len(seconds)) < i)
        assert optimal[i] == (np.isfinite(errors[i]) and not beaten.any() and not twin.any())
    assert 5 < optimal.sum() < 30


def test_means_over_patients_and_both_fronts():
    frame = summarise(rows()).set_index(["method", "value"])
    assert frame["n"].eq(3).all()
    assert frame.loc[("fast", "1"), "seconds"] == pytest.approx(0.01)
    assert frame.loc[("slow", "1"), "seconds_max"] == pytest.approx(8.8)
    assert frame["front_outcome"].tolist() == [True, True, True, False, True]
    assert frame["front_reference"].tolist() == [True, True, True, False, True]


def test_the_best_in_so_many_seconds_is_read_off_the_rows():
    best, failed = answers(summarise(rows()), "virtual cohort")
    assert "under 0.1 s fast, turn 1 (0.900 mm, 0.01 s) is nearest to the outcome" in best
    assert "under 1 s middle, turn 2 (0.650 mm, 0.5 s) is nearest to the outcome" in best
    assert "under 10 s slow, turn 1 (0.600 mm, 8 s)" in best and "n = 3 patients" in best
    assert failed.endswith("nothing.")


def test_a_patient_whose_reference_does_not_converge_stays_but_for_its_distances(tmp_path):
    measured = rows()
    measured.loc[measured["case"] == "B", ["face_error", "face_error_max", "volume_error"]] = np.nan
    measured.loc[(measured["case"] == "B") & (measured["method"] == "slow"), "converged"] = False
    frame = summarise(measured).set_index(["method", "value"])
    assert frame.loc[("fast", "1"), "face_error"] == pytest.approx(0.5 * 1.05) and frame["n"].eq(3).all()
    assert frame["cd"].notna().all() and frame.loc[("slow", "1"), "failed"] == 1
    assert not frame.loc[("slow", "1"), "front_outcome"]
    assert "slow, turn 1 (1 of 3)" in answers(summarise(measured), "virtual cohort")[1]
    write_csv(measured, tmp_path / "rows.csv", TRADEOFF_CASES)
    made = {"cases": tmp_path / "rows.csv", "cohort": "virtual cohort"}
    make(tmp_path / "tradeoff.csv", "studies.tradeoff.table", **made)
    assert "since the reference did not converge: B." in (tmp_path / "tradeoff.md").read_text()


def test_a_reference_that_is_none_is_known_from_its_file(tmp_path):
    patient = tiny_patient(3)
    still = np.zeros((len(patient.points), 3))
    for converged in (True, False):
        write_predictions(tmp_path / "reference.h5", {"tiny": Prediction(still, converged=converged)})
        reference = Reference.of(patient, read_prediction(tmp_path / "reference.h5", "tiny"))
        assert (reference is not None) == converged
    plan = Plan("tiny", {})
    target = patient.skin_points, patient.skin_faces
    judged = choose(patient, plan, *target, 500, 1)
    setting = Setting("x", "none", BASE, 0)
    row = judge(setting, "tiny", patient, Prediction(still), target, judged, None, settings.fem_settings())
    assert row["cd"] < 1e-9 and row["inverted"] == 0
    assert all(np.isnan(row[name]) for name in ("face_error", "face_error_max", "volume_error"))


def traded() -> Tradeoff:
    """The trade-off of six patients of the default study."""
    study = Study.of(CONFIG)
    judged = [case for fold in study.folds.held_out for case in study.folds.judged(fold)]
    variants = graph_networks(CONFIG)
    return Tradeoff(
        study.config, judged, study.methods.registry, study.methods.compared, study.methods.bounds, variants
    )


def test_what_is_not_varied_is_judged_as_it_is_and_no_bound_but_the_noise_of_the_scan_is():
    made = traded()
    assert made.networks == ["pinnochio", "pinnochio_plus"] and len(made.cases) == 6
    assert made.fixed[-1] == "floor_scan" and "oracle" not in made.fixed
    assert not {*VARIED, *made.networks} & {*made.fixed} and {"no_change", "acmt_pretrained", "fem_rlse"} <= {
        *made.fixed
    }
    assert {setting.method for setting in made.fem_settings} == {*VARIED, "fem_lips"}
    assert made.lifts == [("elastic", nodes) for nodes in (1500, 3000, 5000, 10000, 20000)]
    assert len(made.rows(None)["rows"]) == 18


def test_the_settings_vary_one_parameter_at_a_time():
    config = {"reference": 9000, "nodes": [500, 1000], "accuracies": [0.1]}
    contacts = {name: registry(CONFIG)[name].options.get("contact", "") for name in VARIED}
    settings = fem_settings(1000, config, contacts)
    assert (settings[0].method, settings[0].nodes) == ("fem_sliding", 9000)
    assert len({(s.method, s.parameter, s.value) for s in settings}) == len(settings)
    base = [s for s in settings if s.parameter == "nodes" and s.nodes == 1000]
    assert [s.method for s in base] == ["elastic", "fem_bonded", "fem_sliding"]
    assert [s.contact for s in base] == ["", "bonded", "mucosa"]
    assert all(s.nodes == 1000 for s in settings if s.parameter != "nodes")
    assert next(s for s in settings if s.parameter == "accuracy").fem == {"accuracy": 0.1}
    newton = [s for s in settings if s.method == "fem_sliding" and s.parameter == "solver"]
    assert [s.value for s in newton] == ["Newton's method"]
    assert not any(s.fem["kept_factors"] for s in newton)
    variants = {"a": {"newton_corrections": 1, "network": {"channels": 64}}}
    network = {"networks": ["a"], "corrections": [0, 2], "nodes": [500, 1000, 9000]}
    settings = network_settings(1000, network | {"largest_network": 1000}, variants)
    assert [(s.parameter, s.value) for s in settings] == [
        ("corrections", "0"),
        ("corrections", "1, as in the study"),
        ("corrections", "2"),
        ("nodes", "500"),
    ]


def test_judging_the_reference_itself_finds_no_error():
    """And a face moved by a known vector is as far off as that vector is long."""
    patient = tiny_patient(3)
    plan = Plan("tiny", {name: RigidMotion(translation=np.array([0, -1.0, 0])) for name in patient.segments})
    fem = settings.fem_settings(poisson=0.45, kept_factors=True)
    solved = predict_fem(Setting("fem_bonded", "nodes", "", 0, "bonded"), patient, plan, fem, 1)
    assert solved.converged and solved.seconds > 0 and solved.setup_seconds > 0  # of the patient's factors
    reference = Reference(patient, solved.displacement)
    target = patient.moved_skin(solved.displacement), patient.skin_faces
    judged = choose(patient, plan, *target, 500, 1)
    row = judge(Setting("x", "none", BASE, 0), "tiny", patient, solved, target, judged, reference, fem)
    assert row["face_error"] == 0 and row["volume_error"] < 1e-9 and row["cd"] < 1e-9
    assert row["eqres_rel"] < fem.tolerance
    off = patient.moved_skin(solved.displacement) + [0.3, 0, 0.4]
    assert reference.face_errors(patient, off) == pytest.approx(0.5)


def test_table_and_pictures_are_written(tmp_path):
    write_csv(rows(), tmp_path / "rows.csv", TRADEOFF_CASES)
    paths = {name: tmp_path / f"{name}.csv" for name in ("tradeoff_cases", "tradeoff")}
    cohort = {"cohort": "virtual cohort"}
    make(paths["tradeoff_cases"], "studies.tradeoff.cases", rows=[tmp_path / "rows.csv"], **cohort)
    make(paths["tradeoff"], "studies.tradeoff.table", cases=paths["tradeoff_cases"], **cohort)
    text = (tmp_path / "tradeoff.md").read_text()
    assert "virtual cohort, n = 3 held-out patients" in text
    draw(summarise(rows()), [tmp_path / "a.png", tmp_path / "a.svg"])
    assert "A demonstration: 3 patients do not tell methods apart" in texts(tmp_path / "a.svg")
    assert len(check(rows(), TRADEOFF_CASES)) == 15


def test_the_picture_says_what_differs_from_sliding_finite_elements(tmp_path):
    """Patients differ more than methods do: only pairs tell these apart."""
    measured = []
    for number in range(8):
        for method, seconds, cd, each in (
            ("floor_scan", np.nan, 0.3, 0),
            ("no_change", 0, 1.9, 0),
            ("fem_sliding", 1.0, 1.2, 0),
            ("elastic", 0.005, 1.2, 0.01 * (-1) ** number),
            ("pinnochio_plus", 0.055, 1.15, 0.001 * number),
        ):
            row = rows().iloc[0].to_dict() | {"case": str(number), "method": method, "seconds": seconds}
            measured.append(row | {"value": "as in the study", "cd": cd + each + 0.1 * number})
    frame = summarise(pd.DataFrame(measured))
    cells = frame.set_index("method")[["sliding_difference", "sliding_low", "sliding_high"]]
    assert cells.loc["fem_sliding"].eq(0).all() and cells.loc["elastic", "sliding_low"] < 0
    assert cells.loc["pinnochio_plus", "sliding_difference"] == pytest.approx(-0.0465)
    assert cells.loc["pinnochio_plus", "sliding_high"] < 0 < cells.loc["elastic", "sliding_high"]
    assert cells.loc["floor_scan"].isna().all() and frame["front_outcome"].tolist() == [False, True, False, True, True]
    assert "floor_scan" not in " ".join(answers(frame, "virtual cohort"))
    draw(frame, [tmp_path / "a.svg"])
    said = texts(tmp_path / "a.svg")
    for text in (
        "PINNOCHIO plus comes nearest over 8 patients: 1.50 mm in 55 ms; sliding FEM has 1.55 mm in 1 s, told apart",
        *("not told apart from Sliding FEM", "Noise of the scan 0.65", "Sliding FEM 1.55", "No change 2.25"),
        *("Linear elasticity", "10 ms", "0.1 s", "1 s"),
    ):
        assert text in said
    draw(frame.assign(sliding_low=np.nan, sliding_high=np.nan), [tmp_path / "a.svg"])
    assert "in 1 s, not tested" in texts(tmp_path / "a.svg")
