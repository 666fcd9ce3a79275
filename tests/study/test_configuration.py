"""What Snakemake says of a configuration: wrong keys in a few lines, and one that is not that of the results."""

import json
import shutil

from tests.helpers.study import Project


def test_a_wrong_key_is_refused_in_a_few_lines(project):
    done = project.dry_run("--config", "fem={poison: 0.45}", "mesh={nodes: 3}")
    lines = [line for line in done.stdout.splitlines() if "configuration" in line or "mesh.nodes" in line]
    assert done.returncode != 0 and len(done.stdout.splitlines()) < 6 and len(lines) == 2
    assert "  File " not in done.stdout  # no lines of code
    assert "fem.poison ('0.45') is unknown; did you mean fem.poisson: number, > 0, <= 0.4999" in lines[0]
    assert "mesh.nodes is 3; allowed: integer, >= 500, <= 200000" in lines[1] and "Remedy: " in lines[1]


def test_a_patient_is_predicted_from_any_folder_whatever_its_path_is_called(project, tmp_path):
    away, patient = tmp_path / "else where", project.folder / "Grün & Co/007"
    away.mkdir()
    shutil.copytree(project.folder / "examples/P01", patient)
    target = "results/patients/007/import.json"
    settings = [target, "--config", f"patient={patient}", "predict={method: fem_sliding}"]
    done = project.dry_run("--directory", str(away), *settings)
    assert done.returncode == 0 and "import_segmentation" in done.stdout, done.stdout[-2000:]
    done = project.dry_run(target, "--config", "patient=007")
    assert done.returncode != 0 and "patient=./007" in done.stdout and "Traceback" not in done.stdout


def test_a_changed_configuration_is_noticed_without_snakemakes_metadata(project):
    record = project.folder / "results/quick/provenance.json"
    record.parent.mkdir(parents=True)
    config = project.folder / "merged.json"
    recorded = f"onstart:\n    import json; open('{config}', 'w').write(json.dumps(config))\n"
    with open(project.folder / "Snakefile", "a", encoding="utf-8") as snakefile:
        snakefile.write(f"\n\n{recorded}\n\nrule nothing:\n    shell: 'true'\n")
    said = project.quick("--", "nothing")
    record.write_text(json.dumps({"config": json.loads(config.read_text())}))
    assert "made with another configuration" not in said + project.planned("--", "nothing")
    said = project.planned("--config", "fem={poisson: 0.45}", "folds=3", "--", "nothing")
    assert "results/quick, which was made with another configuration: fem.poisson, folds. " in said


def test_a_project_in_a_folder_that_snakemake_takes_for_a_pattern_says_so(tmp_path):
    (tmp_path / "{trial}").mkdir()
    done = Project(tmp_path / "{trial}").snakemake("--dry-run", "--config", "patient=examples/P01", "--", "predict")
    assert done.returncode == 1 and "{trial}/workflow: its path holds a brace" in done.stdout
    assert "Traceback" not in done.stdout and len(done.stdout.splitlines()) < 6
