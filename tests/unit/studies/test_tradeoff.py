import numpy as np
import pandas as pd
import pytest

from pinnochio.columns import check, write_csv
from pinnochio.geometry.rigid import RigidMotion
from pinnochio.methods.registry import graph_networks, registry
from pinnochio.metrics.case_columns import CASES
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
from tests.helpers.rows import row
from tests.helpers.settings import CONFIG
from tests.helpers.tables import make, texts

# method, value, seconds, cd, face error
SETTINGS = (
    ("fast", BASE, 0.01, 0.9, 0.5),
    ("middle", f"1, {BASE}", 0.2, 0.7, 0.2),
    ("middle", "2", 0.5, None, 0.1),
    ("bad", BASE, 0.6, 0.8, 0.3),
    ("slow", BASE, 8.0, 0.6, 0.0),
)
FACTORS = {"A": (1, 1), "B": (1.1, 0.9), "C": (0.9, 1.1)}  # of seconds and errors, by patient


def rows() -> pd.DataFrame:
    """Rows of TRADEOFF_CASES: SETTINGS on patients whose seconds and errors are multiples."""
    cells = []
    for case, (time, error) in FACTORS.items():
        for method, value, seconds, _, face in SETTINGS:
            cell = {"case": case, "method": method, "parameter": "turn", "value": value, "nodes": 100}
            cell |= {"seconds": seconds * time, "setup_seconds": 0, "threads": 1, "converged": True}
            cell |= {"face_error": face * error, "face_error_max": 3 * face, "volume_error": face, "eqres_rel": 0.1}
            cells.append(cell | {"min_jacobian": 0.5, "inverted": 0})
    return pd.DataFrame(cells)


def outcomes(cells=None) -> pd.DataFrame:
    """Rows of CASES: what the study judged of SETTINGS, or of (case, method, seconds, cd)."""
    cells = cells or [
        (case, method, seconds * time, cd * error)
        for case, (time, error) in FACTORS.items()
        for method, _, seconds, cd, _ in SETTINGS
        if cd
    ]
    made = [row(case, method, cd, seconds=seconds) for case, method, seconds, cd in cells]
    return pd.DataFrame(made, columns=[column.name for column in CASES])


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
    frame = summarise(rows(), outcomes()).set_index(["method", "value"])
    assert frame["n"].eq(3).all()
    assert frame.loc[("fast", BASE), "seconds"] == pytest.approx(0.01)
    assert frame.loc[("slow", BASE), "seconds_max"] == pytest.approx(8.8)
    assert frame["front_outcome"].tolist() == [True, True, False, False, True]
    assert frame["front_reference"].tolist() == [True, True, True, False, True]


def test_what_the_study_judged_stands_beside_the_settings():
    """In the row of the setting that it predicts by, with that row's seconds; methods of no setting follow."""
    judged = outcomes([(case, name, 9.0, 0.5) for case in "AB" for name in ("middle", "fem_sliding", "still")])
    frame = summarise(rows(), judged.assign(converged=judged["method"] != "still"))
    assert frame["method"].tolist() == [*(name for name, *_ in SETTINGS), "fem_sliding", "still"]
    middle = frame[frame["method"] == "middle"].set_index("value")
    assert middle["cd"].tolist() == [pytest.approx(0.5), pytest.approx(np.nan, nan_ok=True)]
    assert middle["seconds"].tolist() == pytest.approx([0.2, 0.5]) and middle["n"].eq(3).all()
    still = frame.set_index("method").loc["still"]
    assert (still["n"], still["seconds"], still["sliding_difference"], still["value"]) == (2, 9.0, 0, BASE)
    assert np.isnan(still["face_error"]) and still["parameter"] == "none"
    assert still["failed"] == 2 and not still["front_outcome"]


def test_the_best_in_so_many_seconds_is_read_off_the_rows():
    best, failed = answers(summarise(rows(), outcomes()), "virtual cohort")
    assert "under 0.1 s fast, turn as in the study (0.900 mm, 0.01 s) is nearest to the outcome" in best
    assert "under 1 s middle, turn 1 (0.700 mm, 0.2 s) is nearest to the outcome" in best
    assert "under 1 s middle, turn 2 (0.100 mm, 0.5 s) is nearest to the reference" in best
    assert "under 10 s slow, turn as in the study (0.600 mm, 8 s)" in best
    assert failed.endswith("nothing.")


def test_a_patient_whose_reference_does_not_converge_stays_but_for_its_distances(tmp_path):
    measured = rows()
    measured.loc[measured["case"] == "B", ["face_error", "face_error_max", "volume_error"]] = np.nan
    measured.loc[(measured["case"] == "B") & (measured["method"] == "slow"), "converged"] = False
    frame = summarise(measured, outcomes()).set_index(["method", "value"])
    assert frame.loc[("fast", BASE), "face_error"] == pytest.approx(0.5 * 1.05) and frame["n"].eq(3).all()
    assert frame.loc[("slow", BASE), "failed"] == 1
    assert not frame.loc[("slow", BASE), "front_outcome"]
    assert "slow, turn as in the study (1 of 3)" in answers(frame.reset_index(), "virtual cohort")[1]
    write_csv(measured, tmp_path / "rows.csv", TRADEOFF_CASES)
    write_csv(outcomes(), tmp_path / "judged.csv", CASES)
    made = {"cases": tmp_path / "rows.csv", "judged": tmp_path / "judged.csv", "cohort": "virtual cohort"}
    make(tmp_path / "tradeoff.csv", "studies.tradeoff.table", **made)
    assert "since the reference did not converge: B." in (tmp_path / "tradeoff.md").read_text()


def test_a_reference_that_is_none_is_known_from_its_file(tmp_path):
    patient = tiny_patient(3)
    still = np.zeros((len(patient.points), 3))
    for converged in (True, False):
        write_predictions(tmp_path / "reference.h5", {"tiny": Prediction(still, converged=converged)})
        reference = Reference.of(patient, read_prediction(tmp_path / "reference.h5", "tiny"))
        assert (reference is not None) == converged
    judged = judge(Setting("x", "none", BASE, 0), "tiny", patient, Prediction(still), None, settings.fem_settings())
    assert judged["inverted"] == 0 and judged["min_jacobian"] == pytest.approx(1)
    assert all(np.isnan(judged[name]) for name in ("face_error", "face_error_max", "volume_error"))


def traded() -> Tradeoff:
    """The trade-off of six patients of the default study."""
    study = Study.of(CONFIG)
    judged = [case for fold in study.folds.held_out for case in study.folds.judged(fold)]
    return Tradeoff(study.config, judged, study.methods.registry, graph_networks(CONFIG))


def test_six_patients_are_solved_and_predicted_by_the_networks():
    made = traded()
    assert made.networks == ["pinnochio", "pinnochio_plus"] and len(made.cases) == 6
    assert {setting.method for setting in made.fem_settings} == {*VARIED}
    assert made.lifts == [("elastic", nodes) for nodes in (1500, 3000, 5000, 10000, 20000)]
    assert len(made.rows(None)["rows"]) == 12


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
    judged = judge(Setting("x", "none", BASE, 0), "tiny", patient, solved, reference, fem)
    assert judged["face_error"] == 0 and judged["volume_error"] < 1e-9
    assert judged["eqres_rel"] < fem.tolerance
    off = patient.moved_skin(solved.displacement) + [0.3, 0, 0.4]
    assert reference.face_errors(patient, off) == pytest.approx(0.5)


def test_table_and_pictures_are_written(tmp_path):
    write_csv(rows(), tmp_path / "rows.csv", TRADEOFF_CASES)
    write_csv(outcomes(), tmp_path / "judged.csv", CASES)
    paths = {name: tmp_path / f"{name}.csv" for name in ("tradeoff_cases", "tradeoff")}
    cohort = {"cohort": "virtual cohort"}
    make(paths["tradeoff_cases"], "studies.tradeoff.cases", rows=[tmp_path / "rows.csv"], **cohort)
    cohort |= {"judged": tmp_path / "judged.csv"}
    make(paths["tradeoff"], "studies.tradeoff.table", cases=paths["tradeoff_cases"], **cohort)
    text = (tmp_path / "tradeoff.md").read_text()
    assert "virtual cohort, n = 3 held-out patients" in text
    draw(summarise(rows(), outcomes()), [tmp_path / "a.png", tmp_path / "a.svg"])
    assert "A demonstration: 3 patients do not tell methods apart" in texts(tmp_path / "a.svg")
    assert len(check(rows(), TRADEOFF_CASES)) == 15


def test_the_picture_says_what_mesh_and_accuracy_change_and_what_differs_from_sliding(tmp_path):
    """Patients differ more than methods do: only pairs tell these apart."""
    named = [("fem_sliding", "nodes", f"5000, {BASE}", 1.0, 0.2), ("fem_sliding", "nodes", "20000", 4.0, 0.1)]
    named += [("fem_sliding", "accuracy", value, 0.8, face) for value, face in (("0.5", 0.205), ("exact", 0.2))]
    named += [("elastic", "nodes", f"5000, {BASE}", 0.005, 0.3)]
    measured, judged = [], []
    for number in range(8):
        for method, parameter, value, seconds, face in named:
            cell = rows().iloc[0].to_dict() | {"case": str(number), "method": method, "seconds": seconds}
            measured.append(cell | {"parameter": parameter, "value": value, "face_error": face})
        for method, seconds, cd, each in (
            ("floor_scan", np.nan, 0.3, 0),
            ("no_change", 0, 1.9, 0),
            ("fem_sliding", 1.0, 1.2, 0),
            ("elastic", 0.005, 1.2, 0.01 * (-1) ** number),
            ("pinnochio_plus", 0.055, 1.15, 0.001 * number),
        ):
            judged.append((str(number), method, seconds, cd + each + 0.1 * number))
    frame = summarise(pd.DataFrame(measured), outcomes(judged))
    cells = frame[frame["cd"].notna()].set_index("method")[["sliding_difference", "sliding_low", "sliding_high"]]
    assert cells.loc["fem_sliding"].eq(0).all() and cells.loc["elastic", "sliding_low"] < 0
    assert cells.loc["pinnochio_plus", "sliding_difference"] == pytest.approx(-0.0465)
    assert cells.loc["pinnochio_plus", "sliding_high"] < 0 < cells.loc["elastic", "sliding_high"]
    assert "floor_scan" not in " ".join(answers(frame, "virtual cohort"))
    draw(frame, [tmp_path / "a.svg"])
    said = " ".join(texts(tmp_path / "a.svg").split())
    for text in (
        "PINNOCHIO plus comes nearest over 8 patients: 1.50 mm in 55 ms; sliding FEM has 1.55 mm in 1 s, told apart",
        "nodes change sliding FEM by 0.10 mm, accuracy by 0.005 mm",
        *("not told apart from Sliding FEM", "Noise of the scan 0.65", "Sliding FEM 1.55", "No change 2.25"),
        *("Linear elasticity", "10 ms", "0.1 s", "1 s"),
    ):
        assert text in said
    draw(frame.assign(sliding_low=np.nan, sliding_high=np.nan), [tmp_path / "a.svg"])
    assert "in 1 s, not tested" in " ".join(texts(tmp_path / "a.svg").split())
