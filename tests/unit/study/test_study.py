"""What a study asks for, from its configuration and cases alone."""

from types import SimpleNamespace

import pytest

from pinnochio.errors import InputError
from pinnochio.importing.cohort import Case
from pinnochio.study.cohort import Cohort
from pinnochio.study.inputs.cohort import CohortInputs
from pinnochio.study.inputs.rules import RuleInputs
from pinnochio.study.study import Study
from studies.planner.inputs import PlannerInputs
from tests.helpers.settings import CONFIG


def study(scanned=10, unscanned=2, bones=(), **changes) -> Study:
    """A study of made-up patients S0, S1 ... with a scan and U0, U1 ... without; `bones`: those with bones after it."""
    names = {f"S{n}": "scan.ply" for n in range(scanned)} | {f"U{n}": "" for n in range(unscanned)}
    cases = {
        name: Case(name, f"{name}.nii.gz", f"{name}.json", scan, "bones.stl" if name in bones else "")
        for name, scan in names.items()
    }
    config = CONFIG | {"cohort": "clinic.tsv"} | changes
    return Study(config, "results", Cohort("clinic", cases, virtual=config["cohort"] == "virtual"))


def job(**wildcards) -> SimpleNamespace:
    return SimpleNamespace(**wildcards)


def test_a_virtual_patient_that_is_not_made_leaves_the_others_as_they_are():
    without = CONFIG | {"virtual": CONFIG["virtual"] | {"without": {"V02": "unsolved", "V39": "withdrew"}}}
    whole, fewer = (Study.of(config) for config in (CONFIG, without))
    assert list(fewer.cohort.cases) == [name for name in whole.cohort.cases if name not in ("V02", "V39")]
    assert len(fewer.cohort.cases) == 38 and CohortInputs(fewer).drawn == CohortInputs(whole).drawn
    assert all(fewer.cohort.cases[name] == whole.cohort.cases[name] for name in fewer.cohort.cases)
    assert fewer.cohort.name == f"{whole.cohort.name}, without V02 (unsolved), V39 (withdrew)"


def test_learned_methods_need_a_scanned_patient_per_fold():
    learned = [name for name in CONFIG["methods"] if study().methods.registry[name].trains != "no"]
    assert study(5).methods.untrained == []
    assert study(4).methods.untrained == study(0).methods.untrained == learned != []
    assert study(0, 5, methods=["no_change", "fem_sliding"]).methods.left_out == []
    with pytest.raises(InputError, match="none of 'methods' is left"):
        _ = study(0, 5, methods=["pinnochio"]).methods.left_out


def test_bounds_need_the_virtual_truth():
    clinic, virtual = study().methods, study(cohort="virtual").methods
    assert clinic.left_out == clinic.unbounded == virtual.bounds == ["floor_scan", "oracle_learner", "oracle"]
    assert clinic.bounds == virtual.left_out == [] and clinic.compared == virtual.compared
    with pytest.raises(InputError, match="none of 'methods' is left"):
        _ = study(methods=["floor_scan"]).methods.left_out


def test_a_fold_trains_on_no_patient_that_it_holds_out():
    made = study()
    for fold, held_out in made.folds.held_out.items():
        assert not set(made.folds.training(fold)) & set(held_out)
        assert set(made.folds.training(fold)) | set(made.folds.judged(fold)) == set(made.cohort.scanned)
        inputs = RuleInputs(made)
        folders = inputs.training.gathered("samples")(job(fold=fold, method="pinnochio_plus"))
        assert folders == [f"<results>/held_out/{other}/samples" for other in made.folds.held_out if other != fold]
        read = [job(fold=folder.split("/")[2], kind="samples") for folder in folders]
        files = {file for one in read for file in inputs.gathered.files(one)}
        assert files == {f"<results>/cases/{case}/fem_samples.h5" for case in made.folds.training(fold)}
        fewer = made.folds.training(f"{fold}of2")
        assert len(fewer) == 2 and {*fewer} < {*made.folds.training(f"{fold}of3")} < {*made.folds.training(fold)}
        batch = RuleInputs(made).prediction.batch(f"folds/{fold}", "pinnochio_plus")
        assert batch.cases == held_out and batch.trained == [f"<results>/folds/{fold}/pinnochio_plus/network.pt"]
        assert batch.folders["lifts"] == [f"<results>/held_out/{fold}/lift"]


def test_each_method_predicts_on_its_mesh():
    assert study().model_of("S1", "fem_sliding") == "<results>/cases/S1/model.h5"
    assert study().model_of("S1", "fem_rlse") == "<results>/cases/S1/lips/model.h5"


def test_training_and_prediction_take_the_achieved_motion_where_there_are_bones():
    made = study(bones=("S0", "S1", "U0"))
    assert made.motion_of("S0") == "<results>/cases/S0/achieved.json"
    assert made.motion_of("S2") == RuleInputs(made).patient.motion(job(case="S2")) == "<results>/cases/S2/plan.json"
    fold = made.folds.by_case["S0"]
    for batch in ("folds", "planned"):
        predicted = RuleInputs(made).prediction.batch(f"{batch}/{fold}", "pinnochio")
        assert predicted.folders["scans"] == [f"<results>/held_out/{fold}/scan"] and not predicted.executed
        assert predicted.trained == [f"<results>/folds/{fold}/pinnochio/network.pt"]
    other = next(fold for fold in made.folds.held_out if fold != made.folds.by_case["S0"])
    gathered = RuleInputs(made).gathered
    assert gathered.training(other, "scan") == [
        f"<results>/held_out/{each}/scan" for each in made.folds.held_out if each != other
    ]
    of_scans = job(fold=fold, kind="scan")
    scans = dict(zip(gathered.names(of_scans), gathered.files(of_scans), strict=True))
    assert scans["S0.motion.json"] == "<results>/cases/S0/achieved.json"
    assert scans["S0.plan.json"].endswith("S0/plan.json")
    assert made.cohort.registered == ["S0", "S1", "U0"] and made.both_motions == ["S0", "S1"]


def test_the_arm_of_the_plan_is_there_where_motions_differ():
    assert CONFIG["planned"]["without"] == ["fem_rlse"]
    others = [name for name in CONFIG["methods"] if name not in ("floor_scan", "oracle_learner", "oracle", "fem_rlse")]
    assert study(bones=("S0",), external={"mine": "folder"}).planned == [
        name for name in others if name in study().methods.used
    ]
    for made in (study(), study(bones=("U0",)), study(bones=("S0",), motion="planned")):
        assert made.planned == [] and "planned" not in RuleInputs(made).tables.measured
    assert study(bones=("S0",), motion="planned").motion_of("S0") == "<results>/cases/S0/plan.json"
    plain, registered = (RuleInputs(made).tables.measured for made in (study(), study(bones=("S0",))))
    assert {"planned", "segments"} <= set(registered) and "segments" not in plain


def test_the_mesh_has_the_nodes_that_its_name_says():
    made = study()
    assert RuleInputs(made).patient.nodes(job(home="cases", case="S0", nodes="900")) == 900
    assert RuleInputs(made).patient.nodes(job(home="cases", case="S0")) == CONFIG["mesh"]["nodes"]
    assert made.sized(CONFIG["mesh"]["nodes"], "model.h5") == "<results>/cases/{case}/model.h5"
    assert made.sized(900, "model.h5") == "<results>/cases/{case}/nodes_900/model.h5"


def test_a_study_has_the_tables_that_its_patients_allow():
    tables, few, unscanned = (RuleInputs(made).tables for made in (study(), study(6, folds=2), study(0, 5)))
    assert tables.measured == ["cases", "accuracy", "regions", "better", "ablation", "claims"]
    assert tables.costs == ["stages", "training"] and "better" not in few.measured
    assert unscanned.measured == ["cases"] and unscanned.costs == ["stages"]


def test_intervals_are_calibrated_of_methods_and_of_no_bound():
    named = CONFIG["uncertainty"] | {"methods": ["fem_sliding", "no_change", "oracle"]}
    made = study(uncertainty=named, methods=["oracle", "no_change", "fem_sliding", "pinnochio_plus"])
    assert made.methods.calibrated == ["no_change", "fem_sliding"]


def test_new_patients_must_be_named():
    made = study()
    patients = RuleInputs(made).patients
    for files in (patients.predictions, PlannerInputs(made, patients).files):
        with pytest.raises(InputError, match="no new patient is named"):
            files(job())


def test_new_patients_by_finite_elements_need_no_archive(tmp_path):
    folder = tmp_path / "anna"
    folder.mkdir()
    (folder / "segmentation.nii.gz").touch()
    (folder / "plan.json").touch()
    chosen = CONFIG["predict"] | {"method": "fem_sliding"}
    made = study(patient=str(folder), predict=chosen)
    assert list(made.new_patients["anna"].plans) == ["plan"] and made.choice.method == "fem_sliding"
    wildcards, inputs = job(home="patients", case="anna", plan="/plan", method="fem_sliding"), RuleInputs(made)
    assert inputs.patient.plan(wildcards) == str(folder / "plan.json")
    assert inputs.patients.plans(wildcards) == ["<results>/patients/anna/plan/plan.json"]
    assert inputs.patient.motion(wildcards) == "<results>/patients/anna/plan/plan.json"
    assert inputs.patients.results(wildcards) == ["<results>/patients/anna/plan/fem_sliding/predictions.h5"]
    alone = inputs.prediction.ensemble(wildcards)
    assert not alone.networks and alone.settings["contact"] == "mucosa"


def test_a_method_that_only_an_archive_knows_is_a_graph_network():
    predictor = RuleInputs(study()).prediction.predictor
    assert predictor(job(method="of_an_archive")) == predictor(job(method="pinnochio"))
    assert predictor(job(method="acmt")) != predictor(job(method="pinnochio"))
