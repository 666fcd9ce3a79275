"""Folders and tables of new patients, and the choice of what predicts them."""

import json
import os
import shutil
from pathlib import Path

import pytest

from pinnochio.errors import InputError
from pinnochio.files import fingerprint
from pinnochio.patients.front import FRONT
from pinnochio.patients.model_archive import Archive, configuration_hash
from pinnochio.plans.plan import Plan
from pinnochio.study.choice import choose
from pinnochio.study.patients import markups_in, oddities, read_patients
from tests.helpers.settings import CONFIG


@pytest.fixture
def folder(tmp_path):
    """A patient with a segmentation and no plan."""
    (tmp_path / "P01").mkdir()
    (tmp_path / "P01/segmentation.nii.gz").touch()
    return tmp_path / "P01"


def plans_of(path):
    (patient,) = read_patients(path).values()
    return {name: Path(plan).relative_to(path).as_posix() for name, plan in patient.plans.items()}


def test_a_plan_of_another_case_is_said_and_taken_for_that_of_the_patient(folder):
    (folder / "plans").mkdir()
    plan = {"case": "P02", "segments": {}}
    for name, content in {"other": plan, "own": plan | {"case": "P01"}, "unnamed": {"segments": {}}}.items():
        (folder / f"plans/{name}.json").write_text(json.dumps(content))
    (folder / "plans/damaged.json").write_text("[{")
    (said,) = oddities(read_patients(folder).values())
    assert "plans/other.json names case 'P02'" in said and "'P01'" in said
    assert Plan.read(folder / "plans/other.json", "P01", foreign=True).case == "P01"
    with pytest.raises(InputError, match="belongs to case 'P02'"):
        Plan.read(folder / "plans/other.json", "P01")


def test_a_folder_holds_one_plan_or_several(folder):
    (folder / "plan.json").touch()
    assert plans_of(folder) == {"plan": "plan.json"}
    (folder / "plans/slicer").mkdir(parents=True)
    (folder / "plans/slicer/lefort1.tfm").touch()
    (folder / "plans/setback.json").touch()
    assert plans_of(folder) == {
        "plan": "plan.json", "setback": "plans/setback.json", "slicer": "plans/slicer"
    }  # fmt: skip
    patient = read_patients(f"{folder}/")["P01"]
    assert patient.segmentation == str(folder / "segmentation.nii.gz") and patient.source == str(folder)


def test_a_patient_may_have_no_plan_yet(folder):
    assert plans_of(folder) == {}
    (folder / "plans").mkdir()
    assert plans_of(folder) == {}


def test_a_folder_of_transforms_is_one_plan_and_one_of_surfaces_a_segmentation(folder):
    (folder / "segmentation.nii.gz").unlink()
    for name in ("segmentation/lefort1.stl", "plan/lefort1.tfm", "plan/mandible_distal.tfm"):
        (folder / name).parent.mkdir(exist_ok=True)
        (folder / name).touch()
    assert plans_of(folder) == {"plan": "plan"}
    assert read_patients(folder)["P01"].segmentation == str(folder / "segmentation")


def test_hidden_files_are_nothing_and_files_that_nothing_reads_are_said(folder):
    (folder / "segmentation.nii.gz").rename(folder / "Segmentation.nii.gz")
    (folder / "plans").mkdir()
    for name in ("._lm.mrk.json", "plans/._a.json", "plans/a.JSON", "CT.mhd", "CT.raw", "ct.json", "wish-chin.csv"):
        (folder / name).touch()
    patient = read_patients(folder)["P01"]
    assert [*patient.plans] == ["a"] and Path(patient.volume).name == "CT.mhd" and not patient.markups
    assert oddities([patient]) == [] and len(patient.wishes) == 1
    (folder / "notes.odt").touch()
    assert "nothing reads notes.odt" in oddities(read_patients(folder).values())[0]


@pytest.mark.parametrize("home", ["plans", "plan"])
def test_transforms_that_lie_bare_in_a_folder_of_plans_are_one_plan(folder, home):
    (folder / home).mkdir()
    for name in ("lefort1.tfm", "mandible_distal.tfm", "other.json"):
        (folder / home / name).touch()
    assert plans_of(folder) == {"other": f"{home}/other.json", "plan": home}


def test_names_of_either_case_and_folders_for_files_are_read_or_said(folder):
    (folder / "Covariates.JSON").write_bytes(b'\xef\xbb\xbf{"sex": "Female",\r\n "age": "30,5"}')
    (folder / "plan.json").mkdir()
    for name in ("postop.nii.gz", "Postop.PLY", "b\udcfc.txt"):
        (folder / name).touch()
    (patient,) = read_patients(folder).values()
    assert patient.covariates == {"sex": "female", "age": 30.5}
    assert oddities([patient]) == [f"{folder}: nothing reads b\\udcfc.txt, postop.nii.gz."]


def test_a_file_that_nobody_may_read_is_refused(folder, monkeypatch):
    (folder / "dicom").mkdir()
    (folder / "dicom/ct.dcm").touch()
    monkeypatch.setattr(os, "access", lambda path, mode: Path(path).name != "ct.dcm")
    with pytest.raises(InputError, match="'P01': .*ct.dcm: its permissions forbid"):
        read_patients(folder)


def test_a_folder_that_snakemake_would_read_as_a_wildcard_is_refused(tmp_path):
    (tmp_path / "{trial}/P01").mkdir(parents=True)
    with pytest.raises(InputError, match="brace"):
        read_patients(tmp_path / "{trial}/P01")


def test_the_hash_of_inputs_goes_by_content_not_by_time(folder, tmp_path):
    file = folder / "segmentation.nii.gz"
    before, when = fingerprint([file], tmp_path / "results"), file.stat().st_mtime
    (folder / "copy").mkdir()
    os.utime(shutil.copy(file, folder / "copy"), (0, 0))
    assert fingerprint([folder / "copy" / file.name], tmp_path / "results") == before
    file.write_text("other")
    os.utime(file, (when - 1e6, when - 1e6))
    assert fingerprint([file], tmp_path / "results") != before
    nothing = fingerprint([], tmp_path)
    assert fingerprint([file], tmp_path) == fingerprint(["<results>/virtual/V01/a.nii.gz"], "x") == nothing


def test_a_table_names_several_patients(folder):
    (folder / "plans").mkdir()
    for name in ("a", "b"):
        (folder / f"plans/{name}.json").touch()
    table = folder.parent / "new.tsv"
    rows = ["case\tsegmentation\tplan\tpostop", "P01\tP01/segmentation.nii.gz\tP01/plans\t"]
    table.write_text("\n".join([*rows, "P02\tP01/segmentation.nii.gz\tP01/plans/a.json\t"]) + "\n")
    patients = read_patients(table)
    assert {name: sorted(patient.plans) for name, patient in patients.items()} == {"P01": ["a", "b"], "P02": ["a"]}
    assert {patient.source for patient in patients.values()} == {str(folder), str(folder.parent / "P02")}


@pytest.mark.parametrize(
    ("made", "said"),
    [
        (["plan.json", "segmentation.nrrd"], "segmentation.nii.gz, segmentation.nrrd"),
        (["plan.json", "plans/plan.json"], "plan 'plan' is there twice"),
        (["plans/my plan.json"], "'my plan' is not of 1 to 64 letters"),
        (["plans/lm.mrk.json"], "markups are no plan"),
        (["{a}.mrk.json"], "brace"),
        (["wish_\udcfc.csv"], "not UTF-8"),
    ],
)
def test_what_is_missing_or_there_twice_is_said(folder, made, said):
    for name in made:
        (folder / name).parent.mkdir(exist_ok=True)
        (folder / name).mkdir() if name.endswith("/") else (folder / name).touch()
    with pytest.raises(InputError, match=said) as caught:
        read_patients(folder)
    assert caught.value.case == "P01"


def test_no_such_folder_is_said(tmp_path):
    with pytest.raises(InputError, match="no such folder or table"):
        read_patients(tmp_path / "P09")


def archive(folder, segments=CONFIG["segments"]):
    settings = {name: CONFIG[name] | {} for name in ("mesh", "interfaces", "fem", "lift")}
    settings["mesh"]["nodes"] = 1234
    methods = {"pinnochio_plus": {"corrections": 2, "lift": "elastic", "usual": {}}}
    Archive("clinic", 12, list(segments), ["1", "2"], methods, settings, "abc", "def").write(folder)


def chosen(folder, **predict):
    return choose(CONFIG | {"predict": CONFIG["predict"] | predict}, folder)


def test_a_learned_method_is_used_as_it_was_trained(tmp_path, monkeypatch):
    archive(tmp_path / "models")
    monkeypatch.chdir(tmp_path)
    choice = chosen("models")
    assert (choice.method, choice.corrections, choice.lift) == ("pinnochio_plus", 2, "elastic")
    assert choice.settings["mesh"]["nodes"] == 1234 and choice.archive.cohort == "clinic"
    # Absolute, so that no rule of the study makes them.
    assert choice.networks == [str(tmp_path / f"models/pinnochio_plus/{fold}.pt") for fold in "12"]
    assert all(Path(file).is_absolute() for file in choice.files)


def test_missing_models_are_said_with_both_remedies(tmp_path):
    with pytest.raises(InputError) as caught:
        chosen(tmp_path / "nowhere")
    assert "snakemake archive" in caught.value.remedy and "'models'" in caught.value.remedy
    archive(tmp_path)
    with pytest.raises(InputError, match="the archive has no 'pinnochio', but pinnochio_plus"):
        chosen(tmp_path, method="pinnochio")


def test_other_segments_are_refused_unless_allowed(tmp_path):
    archive(tmp_path, ["mandible"])
    with pytest.raises(InputError, match="names lefort1, .* the models were trained with mandible"):
        chosen(tmp_path)
    assert chosen(tmp_path, other_segments="predict").archive.segments == ["mandible"]
    archive(tmp_path, [*reversed(CONFIG["segments"]), "hyoid"])  # a patient may have fewer than the models know
    assert chosen(tmp_path).archive.segments[0] == CONFIG["segments"][-1]


def test_millimetres_or_seconds_choose_finite_elements_and_not_both(tmp_path):
    choice = chosen(tmp_path / "nowhere", accuracy=0.2)
    assert (choice.method, choice.settings["fem"]["accuracy"], choice.seconds) == ("fem_sliding", 0.2, None)
    assert "on 5000 nodes" in choice.in_words and "some 0.26 mm" in choice.in_words and "20000" in choice.in_words
    choice = chosen(tmp_path / "nowhere", seconds=0.5)
    assert (choice.method, choice.seconds, choice.files) == ("fem_sliding", 0.5, [str(FRONT)])
    with pytest.raises(InputError, match="both accuracy and seconds"):
        chosen(tmp_path / "nowhere", accuracy=0.2, seconds=0.5)


def test_the_hash_of_a_configuration_knows_values_and_not_their_order():
    turned = dict(reversed(CONFIG.items()))
    assert configuration_hash(turned) == configuration_hash(json.loads(json.dumps(CONFIG)))
    assert configuration_hash(CONFIG | {"seed": 2}) != configuration_hash(CONFIG)


def test_what_is_wished_of_the_face_lies_beside_and_is_no_markup_of_the_patient_as_it_is(folder):
    for name in ("wish.mrk.json", "wish_chin.csv", "Wish.ply", "mine.mrk.json", "wishes.txt"):
        (folder / name).touch()
    (patient,) = read_patients(folder).values()
    assert [Path(wish).name for wish in patient.wishes] == ["Wish.ply", "wish.mrk.json", "wish_chin.csv"]
    assert [Path(path).name for path in markups_in(folder)] == ["mine.mrk.json"] and patient.markups == str(folder)
    (folder / "mine.mrk.json").unlink()
    (patient,) = read_patients(folder).values()
    assert patient.markups == ""
