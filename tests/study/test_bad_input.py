"""Bad input stops the study before any heavy work: one clear error, nothing half-written.

What else is refused, and in which words, is in tests/unit/importing/test_refusals.py.
"""

import json
import re

import numpy as np

from tests.helpers.study import good_labels, moving, write_case


def without(code):
    labels = good_labels()
    labels[labels == code] = 1
    return labels


def not_a_number():
    labels = good_labels().astype(np.float32)
    labels[0, 0, 0] = np.nan
    return labels


def run(project, rows, *config, target="meshes"):
    table = project.folder / "cases.tsv"
    table.write_text("case\tsegmentation\tplan\tpostop\n" + "".join(rows))
    config = ("--config", "cohort=cases.tsv", "folds=2", *config)
    return project.snakemake("--keep-going", *config, "--", target, cores=1)


def test_every_bad_case_is_refused_by_name(project):
    defects = {
        "missing_label": ({"labels": without(12)}, "json", "'mandible_distal', which the segmentation does not hold"),
        "not_a_number": ({"labels": not_a_number()}, "nii.gz", "NaN"),
        "no_muscle": ({"labels": without(2)}, "nii.gz", "no muscle is labelled"),
        "no_segment": ({"plan": {"case": "no_segment", "segments": moving("chin")}}, "json", "chin"),
        "wrong_scale": ({"scale": 1e6}, "ply", "times the size"),
    }
    rows = [write_case(project.folder, name, **defect) for name, (defect, _, _) in defects.items()]
    said = [rf"'{name}': [^\n]*{name}\.{suffix}[^\n]*{words}" for name, (_, suffix, words) in defects.items()]
    done = run(project, rows, "unlabelled_muscle=refuse")
    assert done.returncode != 0
    for words in (*said, "Remedy: "):
        assert re.search(words, done.stdout), f"{words}: {done.stdout[-3000:]}"
    left = {path.name for path in (project.folder / "results/cases").rglob("*") if path.is_file()}
    assert not left & {"mesh.vtu", "model.h5"} and not any(re.match(r"\.\d+\.", name) for name in left), left


def test_what_was_good_and_is_no_longer_is_refused_each_time(project):
    """Snakemake puts the older outputs back: they do not count as made of what was refused."""
    row, target = write_case(project.folder), "results/cases/P1/plan.json"
    assert run(project, [row], target=target).returncode == 0
    (project.folder / "P1.json").write_text(json.dumps({"segments": moving("chin")}))
    for _ in range(2):
        done = run(project, [row], target=target)
        assert done.returncode != 0 and "chin" in done.stdout, done.stdout[-2000:]
