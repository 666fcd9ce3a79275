"""The quality report: each figure against a block of tissue whose thickness, contact and elements are known."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from pinnochio.columns import read_table
from pinnochio.importing.repair import KEPT
from pinnochio.metrics.model_quality import contact, off_mesh, quality, thickness
from pinnochio.model.patient import FIXED, FREE, INTERIOR, MOVING, SLIDING
from pinnochio.model.regions import CHIN, NOSE, NOT_JUDGED, UPPER_LIP
from pinnochio.tables.quality import quality_columns, table
from scripts.patient.report_quality import report_quality
from scripts.patient.show_quality import show_quality
from tests.helpers.patients import tiny_patient
from tests.helpers.tables import make, write

SEGMENTS = ("left",)
REPAIRS = [
    {"structure": "left", "what": "fragment to muscle", "voxels": 30},
    {"structure": "air", "what": KEPT, "voxels": 5000},
]


def block():
    """Nodes 5 mm apart, bone plate 1 mm below z = 40, skin at z = 55; cranium beyond x = 35."""
    model = tiny_patient()
    points = np.round((model.points - [10, -80, 40]) / 5) * 5 + [10, -80, 40]
    plate = model.bone_points * [1, 1, 0] + [0, 0, 39]
    return replace(model, points=points, skin_points=points, bone_points=plate)


def imported(case="P1"):
    volumes = {"superficial": 7.25, "muscle": 1.5, "cranium": 2.0, "left": 3.0}
    return {"case": case, "muscle": "labelled", "volume_cm3": volumes, "repairs": REPAIRS}


def test_thickness_is_the_way_from_bone_to_skin():
    measured = thickness(block())
    # The plate's edge looks at the border of the skin, which may go on.
    assert measured == {name: {"mean": 16.0, "p5": 16.0, "p95": 16.0} for name in ("cranium", "left")}


def test_thickness_follows_the_skin_and_ignores_bone_that_looks_away():
    model = block()
    skin = model.points.copy()
    wide = skin[:, 0] > 17
    skin[wide & (skin[:, 2] == 55), 2] = 65
    measured = thickness(replace(model, skin_points=skin))
    assert measured["left"]["p5"] == 16 and 20 < measured["left"]["p95"] < 26 and 23 < measured["cranium"]["mean"] <= 26
    away = thickness(replace(model, bone_normals=-model.bone_normals))
    assert away == {"cranium": None, "left": None}
    bare = thickness(replace(model, bone_points=model.bone_points + [0, 0, 15.5]))
    assert bare == {"cranium": None, "left": None}


def test_contact_is_the_area_of_the_nodes_by_bone_and_type():
    model = block()
    index = np.round((model.points - [10, -80, 40]) / 5).astype(int)
    inner = (index[:, 2] == 0) & (index[:, 0] % 6 > 0) & (index[:, 1] % 4 > 0)
    assert inner.sum() == 15
    kind, beyond = np.full(len(inner), FREE), np.full(len(inner), INTERIOR)
    beyond[inner] = np.where(index[inner, 0] == 5, 10, 11)
    kind[inner] = np.select(
        [index[inner, 0] < 3, index[inner, 0] == 3, index[inner, 0] == 4], [MOVING, SLIDING, FREE], FIXED
    )
    measured = contact(replace(model, node_type=kind, node_beyond=beyond))
    # 25 mm2 each: two rows of three move, one slides, one is released, one is on the cranium.
    assert measured == {
        "cranium": {"fixed": 0.75, "sliding": 0.0, "released": 0.0},
        "left": {"moving": 1.5, "sliding": 0.75, "released": 0.75},
    }


def test_skin_off_the_mesh_is_measured_where_the_face_is_judged(monkeypatch):
    model = tiny_patient()
    face = model.judged_points
    assert off_mesh(model) == {"off_mesh_mean_mm": 0, "off_mesh_p95_mm": 0, "off_mesh_regions_mm": {}}
    points, codes = model.skin_points.copy(), np.full(len(model.skin_points), NOT_JUDGED, np.int8)
    points[face, 2] += np.linspace(0, 4, len(face))
    points[np.setdiff1d(np.arange(len(points)), face), 2] += 50.0  # is not judged
    codes[face] = np.where(np.arange(len(face)) < len(face) // 8, CHIN, NOSE)
    codes[face[-1]] = UPPER_LIP
    monkeypatch.setattr("pinnochio.metrics.model_quality.known_regions", lambda patient: codes)
    said = off_mesh(replace(model, skin_points=points))
    assert said["off_mesh_mean_mm"] == pytest.approx(2) and said["off_mesh_p95_mm"] == pytest.approx(3.8)
    assert list(said["off_mesh_regions_mm"]) == ["upper_lip", "nose"]  # the chin lies within a millimetre
    assert said["off_mesh_regions_mm"]["upper_lip"] == pytest.approx(4)


def test_the_report_holds_the_mesh_and_what_was_repaired():
    model = replace(block(), muscle="derived")
    measured = quality(model, imported())
    assert measured["smallest_volume_mm3"] == pytest.approx(125 / 6, abs=1e-4)
    assert measured["shortest_edge_mm"] == 5 and measured["smallest_dihedral_deg"] == pytest.approx(45, abs=1e-3)
    assert measured["nodes"] == 7 * 5 * 4 and measured["elements"] == 6 * 6 * 4 * 3
    assert measured["repaired_voxels"] == 30 and measured["repairs"] == REPAIRS and measured["muscle"] == "derived"
    assert json.loads(json.dumps(measured)) == measured


def test_the_table_has_one_row_per_case_and_its_twins(tmp_path):
    path = tmp_path / "quality.csv"
    model = block()
    looking_away = replace(model, bone_normals=-model.bone_normals, muscle="single")
    reports = [quality(model, imported("P2")), quality(looking_away, imported("P1"))]
    write(table(reports, SEGMENTS, "clinic"), path)
    frame = read_table(path, quality_columns(SEGMENTS)).set_index("case")
    assert list(frame.index) == ["P1", "P2"] and list(frame["muscle"]) == ["single", "labelled"]
    assert frame.loc["P2", "thickness_left_p95"] == 16 and np.isnan(frame.loc["P1", "thickness_left_p95"])
    assert frame.loc["P1", "volume_muscle"] == 1.5 and frame.loc["P1", "contact_left_moving"] > 0
    for suffix in ("md", "tex", "html"):
        assert "16.00" in path.with_suffix(f".{suffix}").read_text()


def test_patients_with_other_segments_stand_in_one_table():
    """A column for every segment that any of them has, and none for one that nobody has."""
    reports = [quality(replace(block(), segments=(name,)), imported()) for name in ("lefort1", "mandible")]
    for report, name in zip(reports, ("lefort1", "mandible"), strict=True):
        report["case"], report["volume_cm3"] = name, {"superficial": 7.0, "muscle": 1.5, "cranium": 2.0, name: 3.0}
    frame = table(reports, ("lefort1", "mandible", "chin"), "clinic").frame.set_index("case")
    assert frame["volume_lefort1"].isna().tolist() == [False, True]
    assert frame["volume_mandible"].isna().tolist() == [True, False]
    assert not any("chin" in name for name in frame)


def test_report_and_table_are_written_and_repeat_their_bytes(tmp_path):
    block().write(tmp_path / "model.h5")
    (tmp_path / "import.json").write_text(json.dumps(imported()))
    made = []
    for number in (1, 2):
        files = [str(tmp_path / f"{number}.{suffix}") for suffix in ("json", "png")]
        report_quality(str(tmp_path / "model.h5"), str(tmp_path / "import.json"), files[0])
        show_quality("P1", str(tmp_path / "model.h5"), files[1])
        made.append([Path(file).read_bytes() for file in files])
    assert made[0] == made[1] and len(made[0][1]) > 20_000
    arguments = {"reports": [tmp_path / "1.json"], "segments": SEGMENTS, "cohort": "clinic"}
    make(tmp_path / "quality.csv", "pinnochio.tables.quality", **arguments)
    assert len(pd.read_csv(tmp_path / "quality.csv")) == 1 and "clinic" in (tmp_path / "quality.md").read_text()
