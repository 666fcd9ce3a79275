"""The data card says of a cohort what its files hold, and the checksums are those of the files."""

import hashlib
import json
import re
import subprocess

import numpy as np
import pytest

from pinnochio.errors import InputError
from pinnochio.geometry.rigid import RigidMotion
from pinnochio.plans.plan import Plan
from pinnochio.seeds import generator
from pinnochio.virtual.card import data_card, markdown_table, spread
from pinnochio.virtual.case_files import FILES, INPUTS, LOCKED, OUTCOME_CHECKSUMS, OUTCOMES
from pinnochio.virtual.description import numbers
from pinnochio.virtual.ground_truth import EFFECTS
from pinnochio.virtual.parameters import FITTED, SHIFTS, TABLE
from pinnochio.virtual.procedures import DEFORMITIES, Procedure
from pinnochio.virtual.scanned import sample_patient
from scripts.cohort.data_card import describe_cohort
from scripts.cohort.sum_up import sum_up
from studies.cohort_checks.verify_cohort import verify_cohort

CASES = [f"V{number:02d}" for number in range(1, 11)]
CHANGED = {"nodes": 9000, "noise": 0.3, "poisson": "nominal", "coverage": 0.15, "swelling": "nominal"}
ALL = {name: effect.nominal for name, effect in EFFECTS.items()} | CHANGED
OUTCOME = {"reality": "clinic", "learnable": 37, "effects": ALL}
VIRTUAL = {"role": "development", "patients": 10, "spacing": 1.5, "outcome": OUTCOME}
LABELS = {"superficial": 1, "muscle": 2, "cranium": 10}


@pytest.fixture(scope="module")
def anatomies():
    return [
        numbers(sample_patient(generator(3, "card", case), DEFORMITIES[number % 4]))
        | {"procedure": Procedure(chin=number == 2).name}
        for number, case in enumerate(CASES)
    ]


@pytest.fixture(scope="module")
def plans():
    """Maxillae that advance by 1, 2, ... mm and turn by half a degree more each."""
    return [
        Plan(case, {"lefort1": RigidMotion.from_degrees((0.5 * n, 0, 0), (0.25, -float(n), 2.0), np.zeros(3))})
        for n, case in enumerate(CASES, start=1)
    ]


@pytest.fixture(scope="module")
def card(anatomies, plans):
    return data_card(anatomies, plans, seed=3, code="0123abcd", virtual=VIRTUAL, labels=LABELS)


def cells(card, first):
    """Cells of the rows whose first cell is `first`."""
    rows = [line.strip("| ").split(" | ") for line in card.splitlines() if line.startswith(f"| {first} ")]
    return [[cell.strip() for cell in row] for row in rows]


def test_the_card_counts_patients_by_deformity_and_sex(card, anatomies):
    for deformity in DEFORMITIES:
        men = sum(a["male"] for a in anatomies if a["deformity"] == deformity)
        every = sum(a["deformity"] == deformity for a in anatomies)
        assert [deformity, str(every - men), str(men), str(every)] in cells(card, deformity)
    men = sum(a["male"] for a in anatomies)
    assert cells(card, "all") == [["all", str(10 - men), str(men), "10"]]
    assert f"10 simulated patients ({10 - men} women, {men} men)" in card


def test_every_sampled_number_stands_with_its_distribution_and_what_the_cohort_has(card, anatomies):
    for name in TABLE:
        entry = TABLE[name]
        (row,) = cells(card, f"`{name}`")
        values = np.array([a[name] for a in anatomies])
        numbers_shown = [float(text) for text in re.findall(r"-?\d+\.\d+", row[-1])]
        numbers = [values.mean(), values.std(ddof=1), values.min(), values.max()]
        np.testing.assert_allclose(numbers_shown, numbers, atol=0.1 * entry.sd)
        drawn = [f"{entry.mean:g} ± {entry.sd:g}", f"{entry.low:g} to {entry.high:g}", entry.source]
        assert row[2] == entry.unit and [row[3], *row[5:7]] == (["the face", "", ""] if name in FITTED else drawn)
    for deformity, changes in SHIFTS.items():
        shown = {row[1]: row[2] for row in cells(card, deformity) if row[1].startswith("`")}
        assert shown.keys() == {f"`{name}`" for name in changes}
        for name, change in changes.items():
            numbers = [float(text) for text in re.findall(r"[-+]?\d+\.?\d*", shown[f"`{name}`"])]
            assert numbers == [number for number in change if number != "+"]
            assert shown[f"`{name}`"].startswith("mean ") == (change[0] == "+")


def test_plans_are_shown_forward_up_left_and_as_an_angle(card):
    few = [n for n in range(1, 11) if (n - 1) % 4 == 0]  # 1, 5, 9
    (row,) = [row for row in cells(card, DEFORMITIES[0]) if row[1] == "lefort1"]
    assert row[2:] == ["3", spread(few), "2.0 ± 0.0 [2.0, 2.0]", spread([0.25] * 3), spread([0.5 * n for n in few])]
    assert spread(few) == "5.0 ± 4.0 [1.0, 9.0]" and spread([-0.01]) == "0.0 ± 0.0 [0.0, 0.0]"


def test_effects_stand_with_magnitude_and_source(card):
    rows = {row[0]: row for name in EFFECTS for row in cells(card, f"`{name}`")}
    assert len(rows) == len(EFFECTS)
    sizes = {name: rows[f"`{name}`"][2] for name in ("nodes", "noise", "poisson", "swelling", "coverage")}
    assert sizes == {"nodes": "9000", "noise": "0.3", "poisson": "off", "swelling": "off", "coverage": "0.15"}
    assert all(rows[f"`{name}`"][4:] == [effect.noise, effect.source] for name, effect in EFFECTS.items())


def test_the_card_says_who_may_read_what(card):
    for name in FILES:
        assert len(cells(card, f"`{name}`")) == 1
    assert cells(card, "`truth.h5`")[0][-1] == "**evaluation only**"
    for words in ("MIT", "virtual cohort", "| seed | 3 |", "`0123abcd`", "0 air, 1 superficial, 2 muscle", "1.5 mm"):
        assert words in card
    assert markdown_table(["a|b"], [["c|d"]]) == "| a\\|b |\n| --- |\n| c\\|d |"


def test_an_outcome_without_effects_says_so(anatomies, plans):
    plain = VIRTUAL | {"outcome": {"reality": "nominal", "learnable": 37, "effects": "nominal"}}
    card = data_card(anatomies, plans, seed=3, code="", virtual=plain, labels=LABELS)
    sizes = {row[2] for name in EFFECTS for row in cells(card, f"`{name}`")}
    assert sizes == {"off"}


def test_the_checksums_are_those_of_sha256sum(anatomies, plans, tmp_path):
    files = []
    for case, anatomy, plan in zip(CASES, anatomies, plans, strict=True):
        folder = tmp_path / case
        folder.mkdir()
        (folder / "anatomy.json").write_text(json.dumps(anatomy))
        plan.write(folder / "plan.json")
        (folder / "truth.h5").write_bytes(case.encode() * 1000)
        files += [str(path) for path in folder.iterdir()]
    settings = {"seed": 3, "code": "0", "virtual": VIRTUAL, "labels": LABELS}
    sums = tmp_path / "SHA256SUMS"
    describe_cohort(CASES, settings, str(tmp_path / "README.md"))
    sum_up(files[::-1], str(sums))
    lines = sums.read_text().splitlines()
    assert [line.split("  ")[1] for line in lines] == sorted(f"{case}/{name}" for case in CASES for name in
                                                              ("anatomy.json", "plan.json", "truth.h5"))  # fmt: skip
    assert f"{hashlib.sha256(b'V01' * 1000).hexdigest()}  V01/truth.h5" in lines
    check = ["sha256sum", "--check", "--quiet", "--strict", "SHA256SUMS"]
    assert subprocess.run(check, cwd=tmp_path, check=False).returncode == 0
    (tmp_path / "V03/truth.h5").write_bytes(b"other")
    assert subprocess.run(check, cwd=tmp_path, check=False, capture_output=True).returncode == 1
    card = (tmp_path / "README.md").read_text()
    assert "10 simulated patients" in card


def test_operations_are_counted_by_deformity(card):
    (row,) = cells(card, "bimaxillary, genioplasty")
    assert row[1:] == ["0", "0", "1", "0", "1"]
    (row,) = cells(card, "bimaxillary")
    assert row[1:] == ["3", "3", "1", "2", "9"]


def test_the_card_of_a_locked_cohort_tells_no_outcome_and_how_to_reveal_it(anatomies, plans):
    locked = VIRTUAL | {"role": LOCKED}
    card = data_card(anatomies, plans, seed=2, code="", virtual=locked, labels=LABELS)
    assert not any(cells(card, f"`{name}`") for name in OUTCOMES) and all(cells(card, f"`{name}`") for name in INPUTS)
    assert "snakemake reveal" in card and OUTCOME_CHECKSUMS in card and "no setting is ever chosen on it" in card


def test_a_cohort_is_compared_with_its_frozen_checksums(tmp_path):
    for name in ("a", "b", "c"):
        (tmp_path / name).write_text(name)
    files = [str(tmp_path / name) for name in "ab"]
    sum_up(files, str(tmp_path / "SUMS"))
    sum_up([str(tmp_path / "c")], str(tmp_path / "SUMS.outcomes"))
    made, table = [str(tmp_path / name) for name in ("SUMS", "SUMS.outcomes")], tmp_path / "verified.csv"
    frozen = tmp_path / "frozen"
    frozen.write_text("# frozen\n" + "".join((tmp_path / name).read_text() for name in ("SUMS", "SUMS.outcomes")))
    verify_cohort(made, str(frozen), str(table))
    verify_cohort(made[:1], str(frozen), str(table))  # what is not revealed is not compared
    assert table.read_text().splitlines()[1:] == ["a,same", "b,same"]
    (tmp_path / "b").write_text("other")
    sum_up(files, made[0])
    frozen.write_text("".join(line for line in frozen.read_text().splitlines(True) if not line.endswith("  c\n")))
    with pytest.raises(InputError, match="2 of 3 files are not as they were frozen, the first is b"):
        verify_cohort(made, str(frozen), str(table))
    assert table.read_text().splitlines()[1:] == ["a,same", "b,differs", "c,missing"]
