"""The virtual cohort as a benchmark: complete, described, summed up, and as patients are."""

import subprocess

import pandas as pd
import pytest

from pinnochio.virtual.case_files import FILES


@pytest.fixture(scope="module")
def cohort(studied):
    """The packed cohort."""
    studied.quick("--", "cohort", "soft_tissue")
    return studied.folder / "results/quick/virtual"


def test_every_file_is_there_and_summed_up(cohort):
    listed = (cohort / "SHA256SUMS").read_text()
    for number in range(1, 5):
        for name in FILES:
            assert f"V{number:02d}/{name}" in listed
    checked = subprocess.run(["sha256sum", "--check", "SHA256SUMS"], cwd=cohort, capture_output=True, text=True)
    assert checked.returncode == 0, checked.stdout[-2000:]


def test_soft_tissue_follows_the_bone(cohort):
    """Six coarse patients of the clinic's reality say little, but chins follow and noses follow least."""
    ours = pd.read_csv(cohort / "ratios.csv").set_index("ratio")["ours"]
    assert 0.5 < ours["Pog'"] < 1.2 and ours.drop("glabella (mm)").idxmin() == "Prn"
