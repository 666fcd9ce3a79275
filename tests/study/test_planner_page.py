"""`make planner` on a new patient, in headless Chromium: a plan by slider and number, which `predict` then finds."""

import re
import shutil
import subprocess
import sys
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from pinnochio.plans.plan import Plan
from studies.planner.forecast import Forecaster
from studies.planner.prepared import Prepared
from tests.helpers.browser import DRIVEN, chromium, served, uncaught
from tests.helpers.settings import ROOT
from tests.helpers.study import Project

pytestmark = DRIVEN
SMALL = "methods: [no_change, pinnochio_plus]\nablation: []\nreference: pinnochio_plus\nvirtual: {patients: 4}\n"


@pytest.fixture(scope="module")
def clinic(tmp_path_factory):
    """A project with a small study's archive and a patient who has no plan yet."""
    project = Project(tmp_path_factory.mktemp("planner"))
    shutil.copy(ROOT / "Makefile", project.folder)
    (project.folder / ".venv").mkdir()
    (project.folder / ".venv/installed").touch()  # the environment of this test stands for that of `make env`
    (project.folder / "own.yaml").write_text(SMALL)
    done = project.snakemake("--configfile", "config/quick.yaml", "own.yaml", "--", "archive")
    assert done.returncode == 0, done.stdout[-4000:]
    (project.folder / "P01").mkdir()
    shutil.copy(project.folder / "results/quick/virtual/V01/segmentation.nii.gz", project.folder / "P01")
    return project


def make_planner(clinic, *variables, **options):
    command = ["make", "planner", f"BIN={Path(sys.executable).parent}", "MODELS=results/quick/archive", *variables]
    return subprocess.Popen(command, cwd=clinic.folder, text=True, **options)


@pytest.fixture(scope="module")
def address(clinic):
    """Where the planner listens."""
    start = partial(make_planner, clinic, "PATIENT=P01", "PLANNER=--port 0 --no-browser")
    with served(clinic.folder / "planner.txt", start) as place:
        yield place


@pytest.fixture(scope="module")
def page(address):
    with chromium() as browser:
        page = browser.new_page(viewport={"width": 1360, "height": 860})
        page.addresses, page.wrong = [], uncaught(page)
        page.on("request", lambda request: page.addresses.append(request.url))
        page.goto(address)
        yield page


def forecast(page, side="A") -> str:
    """What is said of a side once nothing is under way any more."""
    page.wait_for_timeout(1500)  # what was done has reached the other end
    page.locator("#busy").wait_for(state="detached", timeout=120_000)
    said = page.inner_text(f"#about_{side}")
    assert "smallest volume ratio" in said
    return said


def predicting(clinic) -> subprocess.CompletedProcess:
    """What `snakemake predict` would do with the patient now."""
    return clinic.snakemake("-n", "--config", "patient=P01", "models=results/quick/archive", "--", "predict")


def mean(said) -> float:
    """The mean movement of the face, mm, that is said."""
    return float(re.search(r"moves ([\d.]+) mm", said)[1])


def number(page, name) -> float:
    return float(page.locator(f"#number_{name}").input_value())


def test_a_person_moves_turns_and_saves_and_the_plan_is_predicted(clinic, page):
    assert "there is no plan" in predicting(clinic).stdout
    page.locator("#about_A").get_by_text("smallest volume ratio").wait_for(timeout=120_000)
    first = forecast(page)
    page.click("#segment_mandible_distal")
    for _ in range(80):
        page.locator(".v-slider [role=slider]").nth(0).press("ArrowRight")  # 8 mm of advance
    assert number(page, "advance") == 8.0
    moved = forecast(page)
    page.locator("#number_pitch").fill("3.5")
    page.locator("#number_pitch").press("Enter")
    turned = forecast(page)
    assert mean(first) == 0 and 0.5 < mean(moved) != mean(turned)

    page.locator("#name").fill("mine")
    page.click("#save")
    page.locator("#said").get_by_text("Saved").wait_for()
    plan = Plan.read(clinic.folder / "P01/plans/mine.json", "P01")
    motion = plan.motion("mandible_distal")
    np.testing.assert_allclose([*motion.translation, *motion.degrees], [0, -8, 0, 3.5, 0, 0], atol=1e-6)
    assert not plan.motion("lefort1").translation.any()  # nothing is locked
    expected = Forecaster(Prepared.read(clinic.folder / "results/patients/P01/planner.json"), "cpu")(plan)
    assert f"moves {expected.mean:.2f} mm in the mean, {expected.most:.2f} mm at most" in turned
    assert "patients/P01/mine/pinnochio_plus/index.html" in predicting(clinic).stdout


def test_the_page_asks_nobody_else(address, page):
    port = int(re.search(r":(\d+)/", address)[1])
    assert page.addresses and not page.wrong
    assert all(url.startswith((f"http://127.0.0.1:{port}/", "data:", "blob:")) for url in page.addresses)


@pytest.mark.parametrize(
    ("variables", "said"),
    [
        ((), "PATIENT=FOLDER"),
        (("PATIENT=P02",), "no such folder or table"),
        (("PATIENT=P01", "MODELS=nowhere"), "there is no archive of trained models"),
    ],
    ids=["unnamed", "no patient", "no models"],
)
def test_what_is_missing_is_said(clinic, variables, said):
    out, _ = make_planner(clinic, *variables, stdout=subprocess.PIPE, stderr=subprocess.STDOUT).communicate()
    assert said in out, out[-2000:]


def test_a_method_without_an_interval_is_refused(clinic):
    done = clinic.snakemake("-n", "--config", "patient=P01", "predict={method: elastic}", "--", "planner")
    assert done.returncode != 0 and "and elastic has none" in done.stdout
