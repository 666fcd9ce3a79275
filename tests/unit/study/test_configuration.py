"""Cohort tables, folds, seeds and the configuration's cross-checks."""

import copy
from pathlib import Path

import pytest

from pinnochio.errors import InputError
from pinnochio.importing.cohort import read_cases
from pinnochio.seeds import derive_seed
from pinnochio.study.cohort import read_cohort, virtual_cases
from pinnochio.study.configuration import check_config
from pinnochio.study.folds import assign_folds
from pinnochio.virtual.procedures import Procedure
from tests.helpers.settings import CONFIG

HEADER = "case\tsegmentation\tplan\tpostop\n"
FULL = "sex\tcase\tsegmentation\tplan\tpostop\tpostop_bones\tage\tbmi\tmonths\tclosure\tcinch\n"
ROW = "female\tP1\ta.nii.gz\tplan.json\tpost.ply\tbones\t31.5\t22\t\tVY\tno\n"


def write_table(folder: Path, text: str) -> Path:
    for name in ("a.nii.gz", "plan.json", "post.ply"):
        (folder / name).touch()
    (folder / "bones").mkdir()
    table = folder / "cases.tsv"
    table.write_text(text)
    return table


def test_table_paths_are_relative_to_the_table(tmp_path):
    cases = read_cases(write_table(tmp_path, HEADER + "P1\ta.nii.gz\tplan.json\tpost.ply\nP2\ta.nii.gz\tplan.json\t\n"))
    assert [case.name for case in cases] == ["P1", "P2"]
    assert cases[0].postop == str(tmp_path / "post.ply") and cases[1].postop == ""


def test_bones_and_covariates_are_columns_that_may_be_there(tmp_path):
    """In any order; what is empty is not known."""
    (case,) = read_cases(write_table(tmp_path, FULL + ROW))
    assert case.postop_bones == str(tmp_path / "bones") and case.covariates_file == ""
    assert case.covariates == {"sex": "female", "age": 31.5, "bmi": 22, "closure": "vy", "cinch": False}


def test_a_patient_that_is_left_out_needs_no_files_and_is_named_with_the_reason(tmp_path):
    columns, left_out = HEADER.replace("\n", "\tleft_out\n"), "P2\t\t\t\tCT unreadable\n"
    table = write_table(tmp_path, columns + "P1\ta.nii.gz\tplan.json\tpost.ply\t\n" + left_out)
    cohort = read_cohort(CONFIG | {"cohort": str(table)}, "results")
    assert list(cohort.cases) == ["P1"] and cohort.name == "cases, without P2 (CT unreadable)"
    table.write_text(columns + left_out)
    with pytest.raises(InputError, match="no case"):
        read_cases(table)


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("case\tplan\n", "lacks the column 'segmentation'"),
        (HEADER, "no case"),
        (HEADER + "P1\tb.nii.gz\tplan.json\t\n", "b.nii.gz"),
        (HEADER + "P1\ta.nii.gz\t\t\n", "column plan is empty"),
        (HEADER + "P1\ta.nii.gz\tplan.json\tpast.ply\n", "past.ply"),
        (HEADER + "P1\ta.nii.gz\tplan.json\t\nP1\ta.nii.gz\tplan.json\t\n", "two rows carry this name"),
        (HEADER.replace("postop", "post_op"), "column 'post_op' is unknown; did you mean 'postop'?"),
        (HEADER.replace("postop", "postop\tpostop"), "column 'postop' is there twice"),
        (FULL.replace("bmi", "weight") + ROW, "column 'weight' is unknown"),
        (FULL + ROW.replace("female", "w"), "sex holds 'w'"),
        (FULL + ROW.replace("31.5", "old"), "age holds 'old'"),
        (FULL + ROW.replace("22", "2200"), "bmi holds '2200'. Remedy: write a number of kg/m2 from 10 to 80"),
        (FULL + ROW.replace("bones", "other"), "the postop_bones file does not exist"),
        (HEADER + "P/1\ta.nii.gz\tplan.json\t\n", "letters"),
        (HEADER + "../P1\ta.nii.gz\tplan.json\t\n", "'../P1'"),
        (HEADER + "-P1\ta.nii.gz\tplan.json\t\n", "the first no '-'"),
        (HEADER + 65 * "P" + "\ta.nii.gz\tplan.json\t\n", 20 * "P" + "..."),
        (HEADER + "P1\ta.nii.gz\tplan.json\t\np1\ta.nii.gz\tplan.json\t\n", "'P1' is the same name"),
        (HEADER + "P1\ta.nii.gz\tplan.json\t\tx\n", "5 cells"),
        (HEADER + "P1\ta.nii.gz\n", "2 cells"),
        (HEADER.replace("\t", " "), "is unknown"),
    ],
)
def test_bad_table_is_refused(tmp_path, text, problem):
    with pytest.raises(InputError) as caught:
        read_cases(write_table(tmp_path, text))
    assert problem in str(caught.value) and "Remedy: " in str(caught.value)


def test_missing_table_is_refused(tmp_path):
    with pytest.raises(InputError, match="does not exist"):
        read_cases(tmp_path / "none.tsv")


def test_folds_hold_every_case_out_once_and_evenly():
    names = [case.name for case in virtual_cases(40, "x")]
    folds = assign_folds(names, [], 5, seed=1)
    assert sorted(name for fold in folds.values() for name in fold) == names
    assert {len(fold) for fold in folds.values()} == {8}
    assert folds == assign_folds(names, [], 5, seed=1) != assign_folds(names, [], 5, seed=2)
    # The folds of the published results.
    assert folds["1"] == ["V07", "V10", "V16", "V27", "V32", "V35", "V37", "V39"]


@pytest.mark.parametrize("scanned", [0, 2, 7, 10])
def test_patients_without_a_scan_join_the_folds_and_move_nobody(scanned):
    names, others = [f"S{i}" for i in range(scanned)], [f"U{i}" for i in range(6)]
    folds, alone = assign_folds(names, others, 5, seed=1), assign_folds(names, [], 5, seed=1)
    assert {fold: [n for n in cases if n in names] for fold, cases in folds.items() if fold in alone} == alone
    assert sorted(name for fold in folds.values() for name in fold) == sorted([*names, *others])
    sizes = [len(fold) for fold in folds.values()]
    assert max(sizes) - min(sizes) <= 1 and list(folds) == list("12345")


def test_seed_depends_on_base_stage_and_key():
    assert derive_seed(1, "a", "b") == 7298789200918546523
    others = (2, "a", "b"), (1, "b", "b"), (1, "a", "c")
    assert len({derive_seed(*parts) for parts in ((1, "a", "b"), *others)}) == 4


@pytest.mark.parametrize(
    ("keys", "value", "problem"),
    [
        (("segments",), ["lefort1", "ramus"], "ramus"),
        (("segments",), list(Procedure().segments), r"segments \[.*'mandible'.*lacks.*'virtual.procedures'"),
        (("labels", "muscle"), 1, "share one value"),
        (("reference",), "fscnet", "not among 'methods'"),
        (("external",), {"fem_sliding": "elsewhere"}, "'fem_sliding' is the name of a built-in"),
        (("methods",), ["no_change", "pinocchio"], "'pinocchio' is none of"),
        (("variants", "no_change"), {}, "built-in"),
        (("external",), {"pinnochio": "elsewhere"}, "'external' and in 'variants'"),
        (("external",), {"dgcfp_pretrained": "elsewhere"}, "'external' and in 'surface.networks'"),
        (("variants", "acmt"), {}, "'variants' and in 'surface.networks'"),
        (("ablation",), ["pinnochio", "other"], "ablation names 'other'"),
        (("planned", "without"), ["fem_rsle"], "planned.without names 'fem_rsle'"),
        (("better",), "other", "better names 'other'"),
        (("network", "heads"), 7, "multiple"),
        (("variants", "pinnochio_unified", "network", "lift"), "elastic", "'pinnochio_unified' cannot be built"),
        (("virtual", "patients"), 3, "fewer virtual patients"),
        (
            ("virtual", "without"),
            {"V40": "ill", "V41": "ill"},
            r"virtual.without names \['V41'\], and the patients are V01 to V40",
        ),
        (("virtual", "without"), {f"V{number:02d}": "ill" for number in range(5, 41)}, "fewer virtual patients"),
    ],
)
def test_contradictions_in_the_configuration_are_refused(keys, value, problem):
    config = copy.deepcopy(CONFIG)
    check_config(config)
    node = config
    for key in keys[:-1]:
        node = node[key]
    node[keys[-1]] = value
    with pytest.raises(InputError, match=problem):
        check_config(config)


def test_an_external_method_may_be_the_reference_and_labels_may_lack_muscle():
    labels = {name: value for name, value in CONFIG["labels"].items() if name != "muscle"}
    check_config(CONFIG | {"external": {"mine": "elsewhere"}, "reference": "mine", "labels": labels})
