"""What a study asks for, from its configuration and cases alone."""

from types import SimpleNamespace

import pytest

from pinnochio.errors import InputError
from pinnochio.importing.cohort import Case
from pinnochio.study.study import Study
from pinnochio.training.network_archive import pack
from tests.helpers.settings import CONFIG


def study(scanned=10, unscanned=2, bones=(), **changes) -> Study:
    """A study of made-up patients S0, S1 ... with a scan and U0, U1 ... without; `bones`: those with bones after it."""
    made = Study(CONFIG | {"cohort": "clinic.tsv"} | changes, "results")
    names = {f"S{n}": "scan.ply" for n in range(scanned)} | {f"U{n}": "" for n in range(unscanned)}
    vars(made)["cases"] = {
        name: Case(name, f"{name}.nii.gz", f"{name}.json", scan, "bones.stl" if name in bones else "")
        for name, scan in names.items()
    }
    return made


def job(**wildcards) -> SimpleNamespace:
    return SimpleNamespace(**wildcards)


def test_a_virtual_patient_that_is_not_made_leaves_the_others_as_they_are():
    whole = Study(CONFIG, "results")
    fewer = Study(CONFIG | {"virtual": CONFIG["virtual"] | {"without": ["V02", "V39"]}}, "results")
    assert list(fewer.cases) == [name for name in whole.cases if name not in ("V02", "V39")]
    assert len(fewer.cases) == 38 and fewer.procedures == whole.procedures
    assert all(fewer.cases[name] == whole.cases[name] for name in fewer.cases)


def test_learned_methods_need_a_scanned_patient_per_fold():
    learned = [name for name in CONFIG["methods"] if study().registry[name].trains != "no"]
    assert study(5).untrained == [] and study(4).untrained == study(0).untrained == learned != []
    assert study(0, 5, methods=["no_change", "fem_sliding"]).left_out == []
    with pytest.raises(InputError, match="none of 'methods' is left"):
        _ = study(0, 5, methods=["pinnochio"]).left_out


def test_bounds_need_the_virtual_truth():
    clinic, virtual = study(), study(cohort="virtual")
    assert clinic.left_out == clinic.unbounded == ["floor_scan", "oracle"] and virtual.left_out == []
    assert clinic.bounds == [] and virtual.bounds == ["floor_scan", "oracle"] and clinic.compared == virtual.compared
    with pytest.raises(InputError, match="none of 'methods' is left"):
        _ = study(methods=["floor_scan"]).left_out


def test_a_fold_trains_on_no_patient_that_it_holds_out():
    made = study()
    for fold, held_out in made.held_out.items():
        assert not set(made.training(fold)) & set(held_out)
        assert set(made.training(fold)) | set(made.judged(fold)) == set(made.scanned)
        wildcards = job(fold=fold, method="pinnochio_plus", batch=f"folds/{fold}")
        assert made.of_training("<results>/cases/{case}/x")(wildcards) == [
            f"<results>/cases/{case}/x" for case in made.training(fold)
        ]
        batch = made.predicted(wildcards)
        assert batch.cases == held_out and batch.trained == f"<results>/folds/{fold}/pinnochio_plus/network.pt"
        assert batch.lifts == [f"<results>/cases/{case}/lift_elastic.h5" for case in held_out]


def test_each_method_predicts_on_its_own_mesh():
    assert study().model_of("S1", "fem_sliding") == "<results>/cases/S1/model.h5"
    assert study().model_of("S1", "fem_rlse") == "<results>/cases/S1/lips/model.h5"


def test_training_and_prediction_take_the_achieved_motion_where_there_are_bones():
    made = study(bones=("S0", "S1", "U0"))
    assert made.motion_of("S0") == "<results>/cases/S0/achieved.json"
    assert made.motion_of("S2") == made.motion(job(case="S2")) == "<results>/cases/S2/plan.json"
    assert made.motion_of("S0", "pinnochio", "planned/1") == "<results>/cases/S0/plan.json"
    assert made.motion(job(home="patients", case="S0", plan="/b")) == "<results>/patients/S0/b/plan.json"
    fold = made.fold_of("S0")
    for batch, own in (("folds", "achieved"), ("planned", "plan")):
        predicted = made.predicted(job(batch=f"{batch}/{fold}", method="pinnochio"))
        assert predicted.plans[predicted.cases.index("S0")] == f"<results>/cases/S0/{own}.json"
        assert predicted.trained == f"<results>/folds/{fold}/pinnochio/network.pt"
        judged = made.motions_of_held_out(job(arm=batch, fold=fold, method="pinnochio"))
        assert judged == predicted.plans
    other = next(fold for fold in made.held_out if fold != made.fold_of("S0"))
    assert "<results>/cases/S0/achieved.json" in made.motions_of_training(job(fold=other, method="pinnochio"))
    assert made.registered == ["S0", "S1", "U0"] and made.both_motions == ["S0", "S1"]


def test_the_arm_of_the_plan_is_there_where_motions_differ():
    assert CONFIG["planned"]["without"] == ["fem_rlse"]
    others = [name for name in CONFIG["methods"] if name not in ("floor_scan", "oracle", "fem_rlse")]
    assert study(bones=("S0",), external={"mine": "folder"}).planned == [
        name for name in others if name in study().methods
    ]
    for made in (study(), study(bones=("U0",)), study(bones=("S0",), motion="planned")):
        assert made.planned == [] and "planned" not in made.tables
    assert study(bones=("S0",), motion="planned").motion_of("S0") == "<results>/cases/S0/plan.json"
    assert {"planned", "segments"} <= set(study(bones=("S0",)).tables) and "segments" not in study().tables


def test_finite_elements_alone_solve_what_a_plan_requires():
    full, auto = (study(scene=CONFIG["scene"] | {"mode": mode}).registry for mode in ("full", "auto"))
    assert not any("region" in method.settings for method in full.values())
    regions = {name: own.settings["region"] for name, own in auto.items() if "region" in own.settings}
    names = ("fem_bonded", "fem_sliding", "fem_rlse_bonded", "fem_rlse_mucosa", "fem_rlse")
    assert regions == dict.fromkeys(names, CONFIG["scene"]["amplitude"])


def test_the_mesh_has_the_nodes_that_its_name_says():
    made = study()
    assert made.nodes(job(home="cases", mesh="/nodes_900")) == 900
    assert made.nodes(job(home="cases", mesh="")) == CONFIG["mesh"]["nodes"]
    assert made.sized(CONFIG["mesh"]["nodes"], "model.h5") == "<results>/cases/{case}/model.h5"
    assert made.sized(900, "model.h5") == "<results>/cases/{case}/nodes_900/model.h5"


def test_a_study_has_the_tables_that_its_patients_allow():
    assert study().tables == ["cases", "accuracy", "regions", "better", "ablation", "claims"]
    assert study().costs == ["stages", "training"] and "better" not in study(6, folds=2).tables
    assert study(0, 5).tables == ["cases"] and study(0, 5).costs == ["stages"]


def test_intervals_are_calibrated_of_methods_and_of_no_bound():
    named = CONFIG["uncertainty"] | {"methods": ["fem_sliding", "no_change", "oracle"]}
    made = study(uncertainty=named, methods=["oracle", "no_change", "fem_sliding", "pinnochio_plus"])
    assert made.covered == ["no_change", "fem_sliding"]


@pytest.mark.parametrize("of", ["results_of_patients", "planners_of_patients"])
def test_new_patients_must_be_named(of):
    with pytest.raises(InputError, match="no new patient is named"):
        getattr(study(), of)(job())


def test_new_patients_by_finite_elements_need_no_archive(tmp_path):
    folder = tmp_path / "anna"
    folder.mkdir()
    (folder / "segmentation.nii.gz").touch()
    (folder / "plan.json").touch()
    chosen = CONFIG["predict"] | {"method": "fem_sliding"}
    made = study(patient=str(folder), predict=chosen)
    assert made.plans == ["plan"] and made.choice.method == "fem_sliding"
    wildcards = job(home="patients", case="anna", plan="/plan", method="fem_sliding", batch="patients/anna/plan")
    assert made.plan(wildcards) == str(folder / "plan.json")
    assert made.plans_of_patient(wildcards) == ["<results>/patients/anna/plan/plan.json"]
    assert made.result_of_patient(wildcards) == "<results>/patients/anna/plan/fem_sliding/predictions.h5"
    batch = made.predicted(wildcards)
    assert batch.models == ["<results>/patients/anna/model.h5"] and batch.settings["contact"] == "mucosa"


def test_a_method_that_only_an_archive_knows_is_a_graph_network():
    made = study()
    assert made.predictor(job(method="of_an_archive")) == made.predictor(job(method="pinnochio"))
    assert made.predictor(job(method="acmt")) != made.predictor(job(method="pinnochio"))


def test_networks_are_taken_from_an_archive_of_the_same_folds(tmp_path):
    """Those that it holds; the others are trained, and what was trained otherwise says so in the table."""
    trained, folder = study(), tmp_path / "archive"
    assert trained.taken == [] and set(trained.learned) <= set(trained.trained_here)
    phases = {"finetuning": CONFIG["surface"]["networks"]["acmt"]["finetuning"] | {"steps": 8000}}
    for fold in trained.held_out:
        (tmp_path / fold / "acmt").mkdir(parents=True)
        for name in ("network.pt", "finetuning.csv"):
            (tmp_path / fold / "acmt" / name).write_text(name)
    about = {"held_out": trained.held_out, "shown": trained.config, "provenance": {}}
    pack(trained=tmp_path, out=folder, methods={"acmt": phases}, **about)
    made = study(networks="archive", networks_archive=str(folder))
    assert made.taken == ["acmt"] and "acmt" not in made.trained_here and "dgcfp" in made.trained_here
    assert made.phases("acmt")["finetuning"]["steps"] == 8000 and made.phases("acmt")["pretraining"] is None
    assert made.phases("dgcfp") == trained.phases("dgcfp")
    with pytest.raises(InputError, match="another configuration: folds"):
        _ = study(11, networks="archive", networks_archive=str(folder)).taken
    with pytest.raises(InputError, match="there is no archive of trained networks"):
        _ = study(networks="archive", networks_archive=str(tmp_path)).taken
