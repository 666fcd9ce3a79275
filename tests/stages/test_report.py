"""The report of a study: what its page holds and, in a headless Chromium, what it does."""

import base64
import gzip
import io
import json
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pandas as pd
import PIL.Image
import pytest

from pinnochio.columns import Column, number, write_csv
from pinnochio.errors import InputError
from pinnochio.geometry.closest_points import signed_distances
from pinnochio.metrics.case_columns import CASES
from pinnochio.model.patient import PatientModel
from pinnochio.model.postop import PostopSkin
from pinnochio.model.predictions import Prediction, write_predictions
from pinnochio.report.parts import PARTS
from pinnochio.report.study_page import read_body, rounded
from pinnochio.tables.document import Block, Table, views
from scripts.report.render_volume import render_volume
from scripts.report.write_report import write_report
from scripts.tables.provenance import provenance
from scripts.tables.render_case import render_case
from scripts.tables.render_table import render_table
from tests.helpers.browser import CHROMIUM, chromium, uncaught
from tests.helpers.rows import row
from tests.helpers.settings import CONFIG, ROOT
from tests.helpers.tables import write

FORWARD = "pinnochio_plus"  # carries every node 2 mm forward
CAPTIONS = ROOT / "workflow/report"
SCHEMA = (Column("method", str, "", "method"), *(number(f"column_{n}", "mm", f"column {n}") for n in range(12)))


def decode(text: str, kind: str, columns: int = 1) -> np.ndarray:
    """The numbers (n, columns) again, as view.js reads them."""
    planes = np.frombuffer(gzip.decompress(base64.b64decode(text)), np.uint8).reshape(np.dtype(kind).itemsize, -1)
    steps = np.ascontiguousarray(planes.T).view(kind).reshape(columns, -1).T
    return np.cumsum(steps, axis=0, dtype=kind)


@pytest.fixture(scope="module")
def drawn(patient, tmp_path_factory):
    """Files of the patient's pictures and 3D view; one of its methods has diverged."""
    folder, model = tmp_path_factory.mktemp("drawn"), PatientModel.read(patient.model)
    fields = {"no_change": np.zeros_like(model.points), FORWARD: np.tile([0.0, -2, 0], (len(model.points), 1))}
    fields["fem_sliding"] = np.full_like(model.points, np.nan)
    files = {}
    for method, displacement in fields.items():
        files[method] = str(folder / f"{method}.h5")
        write_predictions(files[method], {patient.case: Prediction(displacement)})
    made = {kind: str(folder / name) for kind, name in (("picture", "T0.png"), ("view", "T0.json"))}
    models = dict.fromkeys(files, patient.model)
    render_case(patient.case, models, patient.plan, patient.postop, files, made["picture"], made["view"])
    made["volume"] = str(folder / "T0_volume.png")
    render_volume(patient.case, patient.model, {FORWARD: files[FORWARD]}, made["volume"])
    return made


@pytest.fixture(scope="module")
def report(patient, drawn, tmp_path_factory):
    """The page of a study with two tables, one figure, the curves of two methods and one patient."""
    folder = tmp_path_factory.mktemp("report")
    frame = pd.DataFrame(
        {"method": ["no_change", FORWARD]} | {f"column_{n}": [n + 100.25, n + 100.5] for n in range(12)}
    )
    for name in ("accuracy", "corrections"):
        view = views(SCHEMA, {column.name: column.name for column in SCHEMA}, {"column_0": -1})
        block = Block.of(frame, view, f"What {name} says: two methods, " + 20 * "word ")
        write(Table(frame, SCHEMA, [block]), folder / f"{name}.csv")
    PIL.Image.new("RGB", (640, 480), "teal").save(folder / "corrections.png")
    provenance(CONFIG, "0123456789ab", str(folder / "provenance.json"))
    errors = {"no_change": 2.0, "fem_sliding": 1.0, FORWARD: 0.8, "floor_scan": 0.3}
    rows = [
        row(f"V{n}", name, cd + 0.1 * n * (name == FORWARD), registration_residual=0.3)
        for name, cd in errors.items()
        for n in range(8)
    ]
    write_csv(pd.DataFrame(rows), folder / "cases.csv", CASES)
    render_table(str(folder / "cases.csv"), "pinnochio.figures.cases", [str(folder / "cases.png")])
    titles = PARTS | {"corrections": "A further part"}
    write_report(
        {name: titles[name] for name in ("accuracy", "corrections", "training")},
        {name: f"What the part {name} says." for name in (*titles, "picture", "volume")},
        [str(folder / f"{name}.html") for name in ("corrections", "accuracy")],
        [str(folder / "corrections.png")],
        {method: str(folder / "corrections.png") for method in ("acmt", "pinnochio")},
        {patient.case: drawn},
        str(folder / "provenance.json"),
        str(folder / "report.html"),
        cases=str(folder / "cases.csv"),
        methods=["no_change", "fem_sliding", FORWARD],
        chart=str(folder / "cases.png"),
        qualities={patient.case: drawn["picture"]},
    )
    return folder / "report.html"


class Elements(HTMLParser):
    """Collects every element's name and attributes, and the text outside scripts and styles."""

    def __init__(self, page: str):
        super().__init__()
        self.elements, self.words, self.inside = [], "", None
        self.feed(page)

    def handle_starttag(self, tag, attributes):
        self.elements.append((tag, dict(attributes)))
        self.inside = tag

    def handle_data(self, data):
        if self.inside not in ("script", "style"):
            self.words += data


def test_numbers_that_vary_by_a_tenth_have_two_decimals():
    said = rounded(
        "<td>1.4562 ± 0.3922</td><td>-0.6154</td><td>0.0123 ± 0.0042</td><td>72.145 ± 13.733</td><td>0.094</td>"
    )
    assert said == "<td>1.46 ± 0.39</td><td>-0.62</td><td>0.0123 ± 0.0042</td><td>72.14 ± 13.73</td><td>0.094</td>"


def test_the_page_holds_the_tables_and_figures_that_there_are_and_no_others(report, patient):
    page = Elements(report.read_text(encoding="utf-8"))
    sections = [attributes["id"] for tag, attributes in page.elements if tag == "section"]
    assert sections == ["patients", "models", "accuracy", "corrections", "training", "way", "provenance"]
    for n in range(12):
        assert page.words.count(f"{n + 100.25:.2f}") == page.words.count(f"{n + 100.5:.2f}") == 2
    pictures = [attributes["alt"] for tag, attributes in page.elements if tag == "img"]
    assert pictures == [
        "All methods on the same patients", "T0: picture", "T0: volume", "T0: model", "A further part",
        "Training: ACMT-Net", "Training: PINNOCHIO",
    ]  # fmt: skip
    assert "Sliding FEM comes nearest to the outcome: 1.00 mm off in the mean" in page.words
    assert "Not told apart from it: PINNOCHIO plus." in page.words and "Demonstration" not in page.words
    titles = {attributes["title"] for tag, attributes in page.elements if tag == "td" and "title" in attributes}
    assert titles == {"no_change", FORWARD} and "No change" in page.words
    for said in ("0123456789ab", "simulated cohort", "For research only", "youngs_modulus", "What corrections says"):
        assert said in page.words
    assert patient.case in page.words


def test_the_page_loads_nothing(report):
    text = report.read_text(encoding="utf-8")
    addresses = [
        value
        for _, attributes in Elements(text).elements
        for name, value in attributes.items()
        if name in ("src", "href", "srcset")
    ]
    assert len(addresses) > 8 and all(address.startswith(("data:", "#")) for address in addresses)
    styles = text[text.index("<style>") : text.index("</style>")]
    assert "url(" not in styles and "@import" not in styles


def test_the_view_holds_what_is_predicted_and_its_error(patient, drawn):
    model, target = PatientModel.read(patient.model), PostopSkin.read(patient.postop).surface
    view = json.loads(Path(drawn["view"]).read_text())
    assert list(view["methods"]) == ["no_change", FORWARD]  # what has diverged has no face
    skin, moved = view["skins"][view["methods"][FORWARD]["skin"]], view["methods"][FORWARD]
    assert np.allclose(view["step"] * decode(skin["points"], "<i2", 3), model.skin_points, atol=0.0251)
    assert np.array_equal(decode(skin["faces"], "<i4", 3), model.skin_faces)
    assert np.allclose(view["step"] * decode(moved["moved"], "<i2", 3), [0, -2, 0])
    judged = np.zeros(len(model.skin_points), bool)
    judged[model.skin_faces[model.face_roi]] = True
    errors = decode(moved["error"], "<i2")[:, 0]
    assert 0 < judged.sum() < len(judged) and np.all(errors[~judged] == -(2**15))
    expected = signed_distances(model.skin_points[judged] + [0, -2, 0], *target)
    assert np.allclose(view["step"] * errors[judged], expected, atol=0.0251)
    assert skin["error"] == view["methods"]["no_change"]["error"]


def test_a_table_without_a_body_is_refused(tmp_path):
    (tmp_path / "corrections.html").write_text("<p>1.0</p>\n")
    with pytest.raises(InputError, match="not the HTML twin of a table"):
        read_body(tmp_path / "corrections.html")


def test_every_part_has_a_caption():
    for name in (*PARTS, "picture", "volume", "workflow"):
        assert 20 < len((CAPTIONS / f"{name}.rst").read_text(encoding="utf-8")) < 400, name


@pytest.fixture(scope="module")
def browser():
    if CHROMIUM is None:
        pytest.skip("no Chromium: apt-get install chromium")
    with chromium() as started:
        yield started


@pytest.fixture
def opened(browser, report):
    """Opens the page from disk at a width; returns it with its requests and errors, which go on filling."""
    pages = []

    def open_page(width):
        page = browser.new_page(viewport={"width": width, "height": 844})
        requests, errors = [], uncaught(page)
        page.on("request", lambda request: requests.append(request.url))
        page.on("console", lambda message: message.type == "error" and errors.append(message.text))
        page.goto(report.as_uri())
        page.wait_for_function("document.querySelector('.plot').data !== undefined")
        pages.append(page)
        return page, requests, errors

    yield open_page
    for page in pages:
        page.close()


# Coordinates of the first mesh, the skin, and the camera of the first view.
SKIN_NOW = "['x', 'y', 'z'].map((name) => Array.from(document.querySelector('.plot').data[0][name]))"
CAMERA = "document.querySelector('.plot')._fullLayout.scene._scene.getCamera().eye"


@pytest.mark.full
def test_the_view_turns_and_shows_plan_and_error(opened, patient):
    page, requests, errors = opened(1280)
    view = page.locator(".view").first
    view.scroll_into_view_if_needed()
    model = PatientModel.read(patient.model)
    planned, before, seen = page.evaluate(SKIN_NOW), page.evaluate(CAMERA), view.locator(".plot").screenshot()
    assert np.allclose(np.transpose(planned), model.skin_points + [0, -2, 0], atol=0.0251)
    assert len(set(np.unique(PIL.Image.open(io.BytesIO(seen)).convert("L")))) > 50  # a shaded surface

    box = view.locator(".plot").bounding_box()
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    page.mouse.move(x, y)
    top = page.evaluate("scrollY")
    page.mouse.wheel(0, -200)  # the page's, as long as the view has not been clicked
    page.wait_for_function(f"scrollY < {top}")
    assert page.evaluate(CAMERA) == pytest.approx(before)
    page.mouse.wheel(0, 200)
    page.wait_for_function(f"scrollY == {top}")
    page.mouse.click(x, y)
    page.mouse.wheel(0, -200)
    page.wait_for_timeout(1000)
    assert page.evaluate("scrollY") == top and page.evaluate(CAMERA) != pytest.approx(before)
    view.get_by_role("button", name="Reset").click()
    assert page.evaluate(CAMERA) == pytest.approx(before)
    page.mouse.click(x, y)
    page.mouse.down()
    page.mouse.move(x + 120, y + 30, steps=5)
    page.mouse.up()
    turned = page.evaluate(CAMERA)
    assert max(abs(turned[axis] - before[axis]) for axis in "xyz") > 0.1

    view.get_by_role("button", name="Before").click()
    assert np.allclose(np.transpose(page.evaluate(SKIN_NOW)), model.skin_points, atol=0.0251)
    assert page.evaluate(CAMERA) == pytest.approx(turned)
    view.get_by_role("button", name="Predicted").click()
    assert page.evaluate(SKIN_NOW) == planned
    view.get_by_role("button", name="Outcome").click()
    assert len(page.evaluate(SKIN_NOW)[0]) == len(PostopSkin.read(patient.postop).points)
    view.get_by_role("button", name="Predicted").click()
    view.get_by_label("Error map").check()
    colours = page.evaluate("document.querySelector('.plot').data[0].vertexcolor")
    assert len(colours) == len(model.skin_points) and len(set(colours)) > 20 and view.locator(".scale").is_visible()
    view.get_by_label("Method").select_option("no_change")
    assert np.allclose(np.transpose(page.evaluate(SKIN_NOW)), model.skin_points, atol=0.0251)
    view.get_by_label("Bones").check()
    assert page.evaluate("document.querySelector('.plot').data[1].visible")
    assert page.evaluate(CAMERA) == pytest.approx(turned)
    view.get_by_role("button", name="Profile").click()
    eye = page.evaluate(CAMERA)
    assert eye["x"] > 1.5 and abs(eye["y"]) < 0.3
    assert not errors
    assert [request for request in requests if not request.startswith(("data:", "blob:"))] == [page.url]


@pytest.mark.full
def test_chart_and_tables_are_readable_on_a_phone(opened):
    page, _, errors = opened(390)
    assert page.evaluate("document.documentElement.scrollWidth") <= 390
    chart = page.locator(".chart img").bounding_box()
    assert chart["x"] >= 0 and chart["x"] + chart["width"] <= 390  # all of it, without scrolling
    tables = page.evaluate(
        """[...document.querySelectorAll('.table .scroll')].map((box) => {
          box.scrollLeft = 1e6;
          const [first, last] = [box.querySelector('td'), box.querySelector('td:last-child')];
          const { left } = first.getBoundingClientRect();
          return {
            beside: left - box.getBoundingClientRect().left,
            box: box.getBoundingClientRect().toJSON(), moved: box.scrollLeft,
            first: first.getBoundingClientRect().left, last: last.getBoundingClientRect().right,
            size: parseFloat(getComputedStyle(first).fontSize),
            caption: box.querySelector('caption').getBoundingClientRect().toJSON(),
          };
        })"""
    )
    assert len(tables) == 2
    for table in tables:
        box, caption = table["box"], table["caption"]
        assert box["left"] >= 0 and box["right"] <= 390
        # Scrolled to its end: the last column is there, the first stays, and the caption can be read in one glance.
        assert table["moved"] > 100 and table["last"] <= box["right"] and table["first"] >= box["left"]
        assert table["beside"] < 2  # no number is seen beside it
        assert table["size"] >= 13 and box["left"] <= caption["left"] and caption["right"] <= 390
    assert not errors
