"""All plans of a patient on one page: what it says, and that it works offline in Chromium."""

import io
import re

import numpy as np
import pandas as pd
import pytest
from PIL import Image

from pinnochio.columns import read_table
from pinnochio.model.measures import MEASURES
from pinnochio.model.regions import CHIN
from pinnochio.patients.face_measures import TABLE, FaceMeasures, write_face
from pinnochio.plans.plan import Plan
from pinnochio.plans.surgery import AMOUNTS, motion_of
from pinnochio.report.plans import ComparedPlan, write_plans
from pinnochio.statistics.intervals import Calibration, Interval
from tests.helpers.browser import DRIVEN, chromium, uncaught
from tests.helpers.virtual_heads import face_alone

PATIENCE = 300_000  # ms
JAW = "mandible_distal"


@pytest.fixture(scope="module")
def page(tmp_path_factory):
    """A page of three plans: nothing, and the lower face 5 mm forward and back."""
    folder = tmp_path_factory.mktemp("plans")
    patient = face_alone("class_ii", 3.0)
    below, width = patient.points[:, 2] < -50, np.full(len(patient.skin_points), 0.8)
    known = Calibration("m", 0.9, 40, 5, {"chin": 0.8}, {}, dict.fromkeys(MEASURES, 0.8))
    interval = Interval(patient.points, patient.points, width, np.full(len(width), CHIN))
    plans = []
    for name, advance in (("rest", 0.0), ("advance", 5.0), ("setback", -5.0)):
        field = np.where(below[:, None], [0, -advance, 0], 0.0)
        write_face(FaceMeasures(patient).rows(field, interval, known), folder / f"{name}.csv")
        motion = motion_of(dict.fromkeys(AMOUNTS, 0.0) | {"advance": advance}, np.zeros(3))
        measures = read_table(folder / f"{name}.csv", TABLE)
        plans.append(ComparedPlan(name, Plan("V", {JAW: motion}), f"{name}/m/index.html", "with care", field, measures))
    write_plans("V<1>", "pinnochio_plus", patient, plans, 0.9, folder / "plans.html")
    return folder / "plans.html", pd.concat({plan.name: plan.measures.set_index("name") for plan in plans})


def test_it_says_what_each_plan_does_and_comes_to(page):
    text = page[0].read_text(encoding="utf-8").split("<script")[0]
    for said in ("V&lt;1&gt;: 3 plans side by side", "advanced 5.0 mm", "set back 5.0 mm", "not moved",
                 "the 90 % interval", "For research only", "With care", 'href="setback/m/index.html"'):  # fmt: skip
        assert said in text, said
    line = re.search(r"<tr><td>Pog&#39; to the vertical.*?</tr>", text, re.DOTALL)[0]
    cells = re.findall(r"<td[^>]*>([^<]*)</td>", line)[1:]
    assert len(cells) == 4 and cells[1] == f"{cells[0]} ± 0.8 (0.0)"
    assert "(+5.0)" in cells[2] and "(−5.0)" in cells[3]
    assert "Interlabial gap" not in text  # no mouth slit in this mesh: nothing to say of any plan
    assert page[1].loc[("advance", "pog_forward"), "change"] == 5


@DRIVEN[0]
@DRIVEN[1]
def test_it_works_offline_and_leaves_the_scrolling_to_the_page(page):
    with chromium() as browser:
        context = browser.new_context(viewport={"width": 1280, "height": 500}, offline=True)
        shown = context.new_page()
        shown.set_default_timeout(PATIENCE)
        wrong = uncaught(shown)
        shown.on("console", lambda said: wrong.append(said.text) if said.type == "error" else None)
        shown.goto(page[0].as_uri())
        shown.locator("body[data-drawn=yes]").wait_for(state="attached")
        assert shown.locator(".plot canvas").count() >= 3
        first = shown.locator(".plot").nth(1)
        shown.click("text=Profile")
        shown.wait_for_timeout(3000)
        plain = first.screenshot()
        assert len(np.unique(Image.open(io.BytesIO(plain)).convert("L"))) > 50  # a shaded surface
        for button in ("Displacement", "Before"):
            shown.click(f"text={button}")
            shown.wait_for_timeout(3000)
            assert first.screenshot() != plain
            shown.click("text=After the plan" if button == "Before" else f"text={button}")
            shown.wait_for_timeout(3000)
            assert first.screenshot() == plain
        shown.locator("figure").first.hover()
        shown.mouse.wheel(0, 200)
        shown.wait_for_function("window.scrollY > 100")
        shown.wait_for_timeout(1000)  # the scrolling has come to rest
        shown.locator("figure").first.click()
        top = shown.evaluate("window.scrollY")
        shown.mouse.wheel(0, -100)
        shown.wait_for_timeout(1000)
        assert shown.evaluate("window.scrollY") == top
    assert not wrong
