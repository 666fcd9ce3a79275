"""Which jobs a cohort of scanned and unscanned patients asks for, and what each of them reads (nothing is run)."""

import re

import pytest

from tests.helpers.study import jobs as counted
from tests.helpers.study import write_cohort


def plan_jobs(project, *arguments, folds=3):
    """Input files of each output that the study would make (paths below results/; of a gathering folder these), and all
    that was said."""
    done = project.dry_run("--config", "cohort=cases.tsv", f"folds={folds}", *arguments, cores=1)
    assert done.returncode == 0, done.stdout[-3000:]
    jobs = {}
    for reasons in re.findall(r"Reason: (Missing output files: .*)", done.stdout):
        parts = dict(part.split(": ") for part in reasons.split("; "))
        made = paths(parts.pop("Missing output files"))
        jobs |= dict.fromkeys(made, {file for listed in parts.values() for file in paths(listed)})
    return {made: set().union(*(opened(file, jobs) for file in files)) for made, files in jobs.items()}, done.stdout


def opened(file, jobs):
    return jobs[file] if file.startswith("held_out/") else {file}


def paths(listed):
    return [file.removeprefix("results/") for file in listed.split(", ")]


def cases_read(files, name):
    return {file.split("/")[1] for file in files if file.endswith(f"/{name}")}


def test_bones_after_surgery_decide_what_motion_a_case_is_trained_and_predicted_with(project):
    """Given for three scanned patients and one without a scan; from the plan too, on which intervals are calibrated."""
    write_cohort(project, SCANNED, UNSCANNED)
    table = project.folder / "cases.tsv"
    header, *rows = table.read_text().splitlines()
    with_bones = {"S0", "S1", "S2", "U1"}
    (project.folder / "bones.stl").touch()
    rows = [f"{row}\t{'bones.stl' if row[:2] in with_bones else ''}\t30" for row in rows]
    table.write_text("\n".join([f"{header}\tpostop_bones\tage", *rows]) + "\n")
    jobs, _ = plan_jobs(project, "--", "all", "inputs", "uncertainty")
    assert cases_read(jobs["cohort.csv"], "achieved.json") == with_bones
    assert {f"cases/{name}/covariates.json" for name in [*SCANNED, *UNSCANNED]} <= set(jobs)
    for fold in "123":
        held_out = cases_read(jobs[f"folds/{fold}/pinnochio/metrics.csv"], "model.h5")
        others = {*SCANNED, *UNSCANNED} - held_out
        files = jobs[f"folds/{fold}/pinnochio/network.pt"]
        assert cases_read(files, "achieved.json") == others & with_bones
        assert cases_read(files, "postop.h5") == others & {*SCANNED}
        for arm in ("folds", "planned"):  # in one job
            files = jobs[f"{arm}/{fold}/pinnochio/metrics.csv"]
            assert cases_read(files, "achieved.json") == held_out & with_bones
            assert cases_read(files, "plan.json") == held_out
            assert f"folds/{fold}/pinnochio/network.pt" in files
        assert f"planned/{fold}/pinnochio/network.pt" not in jobs
        assert f"planned/{fold}/pinnochio/predictions.h5" in jobs["methods/pinnochio/coverage.csv"]
    assert {"tables/planned.csv", "tables/segments.md"} <= set(jobs)
    assert cases_read(jobs["tables/segments.csv"], "segments.csv") == with_bones
    planned, _ = plan_jobs(project, "motion=planned")
    assert "tables/planned.csv" not in planned and not any(path.startswith("planned/") for path in planned)
    assert not cases_read(planned["folds/1/pinnochio/metrics.csv"], "achieved.json")


ON_LIPS = {"fem_rlse_bonded", "fem_rlse_mucosa", "fem_rlse"}
SCANNED, UNSCANNED = [f"S{i}" for i in range(6)], ["A1", "U1", "U2", "U3"]


def test_patients_without_a_scan_are_predicted_and_measured_but_never_trained_on(project):
    write_cohort(project, SCANNED, UNSCANNED)
    jobs, _ = plan_jobs(project)
    held_out = {}
    for fold in "123":
        for method in ("no_change", "fem_bonded", "fem_sliding", "pinnochio"):
            files = jobs[f"folds/{fold}/{method}/metrics.csv"]
            held_out.setdefault(fold, cases_read(files, "model.h5"))
            assert cases_read(files, "model.h5") == held_out[fold], (method, fold)
            assert cases_read(files, "postop.h5") == held_out[fold] & set(SCANNED) == cases_read(files, "judged.h5")
        training = set(SCANNED) - held_out[fold]
        files = jobs[f"folds/{fold}/pinnochio/network.pt"]
        assert cases_read(files, "postop.h5") == training and not cases_read(files, "model.h5") & held_out[fold]
        files = jobs[f"folds/{fold}/pinnochio/pretrained.pt"]
        assert cases_read(files, "fem_samples.h5") == training and not cases_read(files, "model.h5") & held_out[fold]
        assert not any("judged" in file or "true_motion" in file for file in files)
    assert sorted(name for cases in held_out.values() for name in cases) == sorted([*SCANNED, *UNSCANNED])
    assert "tables/accuracy.csv" in jobs and not any(f"cases/{name}/postop.h5" in jobs for name in UNSCANNED)
    assert not any(re.match(r"folds/\dof", path) for path in jobs)  # of the learning curve
    write_cohort(project, SCANNED, [])
    alone, _ = plan_jobs(project)
    for path, files in alone.items():
        if path.endswith(".pt"):
            assert {file for file in jobs[path] if file.split("/")[1] not in UNSCANNED} == files
    for fold, cases in held_out.items():
        assert cases_read(alone[f"folds/{fold}/no_change/metrics.csv"], "model.h5") == cases & set(SCANNED)


@pytest.mark.parametrize(("scanned", "judged"), [([], False), (["S0", "S1"], True)])
def test_too_few_scans_leave_the_learned_method_out_and_nothing_else(project, scanned, judged):
    write_cohort(project, scanned, UNSCANNED)
    jobs, said = plan_jobs(project)
    learned = "pca_linear, fem_learned, acmt_pretrained, dgcfp_pretrained, "
    learned += "pinnochio_unified, pinnochio_no_physics, pinnochio, pinnochio_plus"
    assert f"Left out: {learned}. Training by cross-validation needs a post-operative scan of" in said
    assert f"{len(scanned)} of {len(scanned) + 4} patients have one" in said
    assert "Left out: floor_scan, oracle_learner, oracle. Bounds read the truth" in said
    assert not any("pinnochio" in path or "acmt" in path or path.endswith((".pt", "fem_samples.h5")) for path in jobs)
    made = {path.split("/")[2] for path in jobs if path.endswith("metrics.csv")}
    assert made == {"no_change", "ratio", "elastic", "fem_bonded", "fem_sliding"} | ON_LIPS
    assert "tables/cases.csv" in jobs and "provenance.json" in jobs
    assert ("tables/accuracy.csv" in jobs) == ("tables/regions.csv" in jobs) == judged
    assert "tables/stages.csv" in jobs and not {"tables/training.csv", "tables/landmarks.csv"} & set(jobs)


def test_the_picture_of_an_unscanned_patient_is_refused_by_name(project):
    write_cohort(project, SCANNED, UNSCANNED)
    done = project.dry_run("--config", "cohort=cases.tsv", "--", "results/figures/U1.png")
    assert done.returncode != 0 and "'U1'" in done.stdout and "no post-operative scan" in done.stdout


def test_an_external_method_reads_its_held_out_cases_and_a_missing_file_is_named(project):
    write_cohort(project, SCANNED, UNSCANNED)
    folder = project.folder / "elsewhere"
    folder.mkdir()
    for number, name in enumerate([*SCANNED, *UNSCANNED]):
        (folder / f"{name}.{('npz', 'vtu')[number % 2]}").touch()
    mine = ("external={mine: elsewhere}", "reference=mine", "methods=[no_change]")
    jobs, said = plan_jobs(project, *mine)
    read = [name for fold in "123" for name in cases_read(jobs[f"folds/{fold}/mine/predictions.h5"], "mesh.vtu")]
    assert sorted(read) == sorted([*SCANNED, *UNSCANNED])
    assert "Left out" not in said and "folds/1/fem_sliding/metrics.csv" not in jobs
    (folder / "S3.vtu").unlink()
    done = project.dry_run("--config", "cohort=cases.tsv", *mine)
    assert done.returncode != 0
    for words in ("'S3'", "elsewhere", "neither S3.npz nor S3.vtu", "Remedy: "):
        assert words in done.stdout
    assert project.dry_run("--config", "cohort=cases.tsv", *mine, "--", "inputs").returncode == 0


def test_a_further_study_records_what_made_its_table_and_an_ablation_of_no_variants_is_none(project):
    write_cohort(project, SCANNED, UNSCANNED)
    jobs, _ = plan_jobs(project, "ablation=[]", "--", "all", "design", "uncertainty")
    assert "tables/accuracy.csv" in jobs and "tables/ablation.csv" not in jobs
    for table in ("design", "coverage"):
        assert jobs[f"tables/{table}.provenance.json"] == {f"tables/{table}.csv"}


@pytest.mark.parametrize(("patients", "folds"), [(2, "1"), (3, "12")])
def test_the_tradeoff_judges_the_first_folds_patients_by_the_networks_of_their_fold(project, patients, folds):
    write_cohort(project, SCANNED, UNSCANNED)
    jobs, _ = plan_jobs(project, f"tradeoff={{patients: {patients}}}", "--", "tradeoff")
    judged = {path.split("/")[1] for path in jobs if path.startswith("tradeoff/")}
    assert len(judged) == patients and judged <= set(SCANNED)
    for fold in folds:
        held_out = judged & cases_read(jobs[f"held_out/{fold}/model"], "model.h5")
        for case in held_out:
            read = {path for path in jobs[f"tradeoff/{case}/networks.csv"] if path.startswith("folds/")}
            assert read == {f"folds/{fold}/{name}/network.pt" for name in ("pinnochio", "pinnochio_plus")}
        judged -= held_out
    assert not judged
    sizes = {size[1] for path in jobs if (size := re.search(r"/nodes_(\d+)/", path))}
    assert sizes == {"1500", "3000", "10000", "20000", "30000"}  # the study's own 5,000 are there
    assert jobs["tables/tradeoff.csv"] == {"tables/tradeoff_cases.csv", "tables/cases.csv"}


def test_a_tradeoff_of_one_patient_is_refused(project):
    write_cohort(project, SCANNED[:1], UNSCANNED)
    done = project.dry_run("--config", "cohort=cases.tsv", "folds=3", "--", "tradeoff")
    assert done.returncode != 0 and "the trade-off wants two" in done.stdout


@pytest.mark.parametrize("option", ["--list", "--rulegraph"])
def test_what_runs_nothing_needs_no_number_of_cores(project, option):
    done = project.forked(option, "--configfile", "config/quick.yaml")
    assert done.returncode == 0, done.stdout[-2000:]
    assert "model_case" in done.stdout


def test_a_locked_cohort_is_packed_without_its_outcomes_until_they_are_revealed(project):
    """Other patients in a folder of their own; the whole study makes the outcomes that it trains on."""
    fewer = ("--config", "virtual={patients: 8}", "--")
    locked = ("--configfile", "config/locked.yaml", *fewer)
    said, revealing = (project.dry_run(*locked, target).stdout for target in ("cohort", "reveal"))
    packed, revealed = counted(said), counted(revealing)
    assert packed["virtual_patient"] == 8 and packed["data_card"] == packed["sum_up"] == 1
    assert "virtual_outcome" not in packed
    assert revealed["virtual_outcome"] == 8 and revealed["sum_up"] == 1
    open_one = counted(project.dry_run(*fewer, "cohort").stdout)
    assert open_one["virtual_outcome"] == 8
    assert "results/locked/virtual/V01/segmentation.nii.gz" in said and "results/virtual/" not in said


def test_the_learning_curve_trains_on_fewer_and_holds_out_the_same(project):
    """Metrics of fewer patients come from jobs of their own; those of all are the study's own.

    Scaling, planned with it, asks for every size of one patient.
    """
    write_cohort(project, SCANNED, UNSCANNED)
    chosen = "learning={methods: [pinnochio_plus, pca_linear], patients: [2, 3, 500], folds: 2}"
    jobs, _ = plan_jobs(project, chosen, "scaling={nodes: [500, 900, 5000]}", "--", "learning", "scaling")
    meshes = {f"cases/S0/{size}model.h5" for size in ("nodes_500/", "nodes_900/", "")}
    lifts = {path.replace("model.h5", "lift_elastic.h5") for path in meshes}
    assert jobs["tables/scaling.csv"] == meshes | lifts and "tables/scaling.md" in jobs
    held_out = cases_read(jobs["folds/1/pinnochio_plus/metrics.csv"], "model.h5")
    training = cases_read(jobs["folds/1/pinnochio_plus/pretrained.pt"], "fem_samples.h5")
    for patients in (2, 3):  # of these, see tests/unit/study
        fold = f"folds/1of{patients}"
        assert cases_read(jobs[f"{fold}/pinnochio_plus/pretrained.pt"], "fem_samples.h5") == training
        assert cases_read(jobs[f"{fold}/pca_linear/fitted.h5"], "postop.h5") == training
        assert cases_read(jobs[f"{fold}/pinnochio_plus/metrics.csv"], "model.h5") == held_out
        assert f"{fold}/pinnochio_plus/network.pt" in jobs[f"{fold}/pinnochio_plus/metrics.csv"]
    read = {file.rsplit("/", 1)[0] for file in jobs["tables/learning.csv"]}
    assert read == {"folds/1/fem_sliding", "folds/2/fem_sliding"} | {
        f"folds/{fold}{part}/{method}"
        for fold in "12"
        for part in ("of2", "of3", "")
        for method in ("pinnochio_plus", "pca_linear")
    }
    assert "folds/1/pinnochio/network.pt" not in jobs
