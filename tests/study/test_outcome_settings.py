"""Nothing that is set for the methods moves the truth: the simulated outcome has settings of its own."""

import json

import pytest

from pinnochio.virtual.case_files import FILES
from tests.helpers.settings import CONFIG
from tests.helpers.study import Project, jobs

CHANGED = {
    "fem": {
        **{"youngs_modulus": {"muscle": 7, "superficial": 5}, "poisson": 0.45, "volumetric": "p1"},
        **{"increments": 3, "tolerance": 1e-5, "accuracy": 0.3, "max_iterations": 20, "max_systems": 200},
        **{"linear_solver": "scipy", "kept_factors": False},
    },
    "mesh": {"nodes": 1600, "minimum_dihedral": 10, "bone_edge": 7},
    "interfaces": {name: value + 1 for name, value in CONFIG["interfaces"].items()},
    "network": {
        **{"boundary_layers": 1, "volume_layers": 2, "rest_layers": 1, "channels": 48, "heads": 2, "neighbours": 4}
    },
}


@pytest.fixture(scope="module")
def cohort(tmp_path_factory) -> Project:
    """A project whose cohort counts as made: empty files will do, because nothing but Snakemake looks at them."""
    project = Project(tmp_path_factory.mktemp("cohort"))
    folder = project.folder / "results/quick/virtual"
    cases = [f"V{number:02d}" for number in range(1, 5)]
    files = [f"{case}/{name}" for case in cases for name in FILES]
    files += [f"anatomy.{suffix}" for suffix in ("csv", "md", "tex", "html")]
    for name in [*files, "README.md", "SHA256SUMS"]:
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text("made\n")
    project.quick("--touch", "--forceall", "--", "cohort")
    return project


def planned_rules(project: Project, **sections: dict) -> set[str]:
    """Rules of the jobs that making the cohort would run, with changed sections."""
    changed = [f"{section}={json.dumps(changes)}" for section, changes in sections.items()]
    said = project.planned("--config", *changed, "--", "cohort")
    return set() if "Nothing to be done" in said else {*jobs(said)} - {"cohort"}


def test_no_setting_of_the_methods_makes_an_outcome_again(cohort):
    for section, changes in CHANGED.items():
        different = {key for key, value in changes.items() if value != CONFIG[section][key]}
        assert section == "network" or different == set(CONFIG[section])
    assert planned_rules(cohort, **CHANGED) == set()


@pytest.mark.parametrize(
    "changes",
    [
        {"fem": {"youngs_modulus": {"muscle": 7}}},
        {"mesh": {"bone_edge": 7}},
        {"interfaces": {"release": 6}},
        {"effects": {"noise": 0.4}},
        {"reality": "same_modality"},
    ],
    ids=lambda changes: next(iter(changes)),
)
def test_a_setting_of_the_outcomes_does(cohort, changes):
    assert "virtual_outcome" in planned_rules(cohort, virtual={"outcome": changes})
