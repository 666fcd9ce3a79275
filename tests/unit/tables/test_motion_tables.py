"""The tables of the registered motions and of what it costs to predict from the plan."""

import numpy as np
import pandas as pd
import pytest

from pinnochio.columns import read_table, write_csv
from pinnochio.geometry.rigid import RigidMotion
from pinnochio.importing.segment_registration import FITS
from pinnochio.metrics.case_columns import CASES
from pinnochio.model.surfaces import BoneSurface
from pinnochio.plans.plan import Plan
from pinnochio.tables.planned import PLANNED
from pinnochio.tables.segments import SEGMENTS, motion_errors
from tests.helpers.rows import row
from tests.helpers.tables import make

NAMES = ("lefort1", "mandible_distal")


def rows_of(cost):
    return [row(f"V{i}", method, 1 + 0.1 * i + add + cost * (1 + 0.01 * i)) for method, add in (("a", 0), ("b", 0.5))
            for i in range(8)]  # fmt: skip


def test_the_cost_of_the_plan_is_the_mean_of_paired_differences(tmp_path):
    files = {}
    for arm, cost in (("achieved", 0.0), ("planned", 0.4)):
        files[arm] = tmp_path / f"{arm}.csv"
        write_csv(pd.DataFrame(rows_of(cost)), files[arm], CASES)
    table, cases = tmp_path / "planned.csv", [f"V{i}" for i in range(7)]  # V7 has no achieved motion
    arms = {arm: [path] for arm, path in files.items()}
    make(table, "pinnochio.tables.planned", **arms, cases=cases, methods=["b", "a"], cohort="test cohort", seed=3)
    made = read_table(table, PLANNED).set_index("method")
    assert list(made.index) == ["b", "a"] and (made["n"] == 7).all()
    assert made.loc["a", "cost"] == pytest.approx(0.4 * 1.03, abs=1e-4)
    assert made.loc["a", "cost_low"] < made.loc["a", "cost"] < made.loc["a", "cost_high"]
    assert made.loc["a", "cd_achieved_mean"] == pytest.approx(1.3) and made.loc["a", "test"] == "exact"
    assert made.loc["a", "p"] == pytest.approx(2 / 2**7, abs=1e-3) and (made["p_holm"] < 0.05).all()
    text = table.with_suffix(".md").read_text()
    assert "what a surgeon has beforehand" in text and "test cohort, n = 7 patients" in text and "| 0.4120" in text


def bone():
    rng = np.random.default_rng(0)
    points = np.concatenate([rng.uniform(-20, 20, (30, 3)) + [0, 0, 30 * n] for n in (-1, 0, 1)])
    return BoneSurface(points, points, np.zeros((0, 3), np.int32), np.repeat([-1, 0, 1], 30), NAMES)


def test_errors_are_of_the_surface_of_each_segment():
    surface = bone()
    true = Plan("P1", {"lefort1": RigidMotion(translation=np.array([0, -5.0, 0]))})
    turned = RigidMotion.from_degrees((1, 0, 0), (0, -5, 0), (0, 0, 0))
    still = Plan("P1", {"lefort1": turned, "mandible_distal": RigidMotion(translation=np.array([3.0, 4, 0]))})
    errors = motion_errors(still, true, surface)
    assert errors["lefort1"]["error_degrees"] == pytest.approx(1)
    reach = np.linalg.norm(surface.points[surface.segment == 0][:, 1:], axis=1)
    assert errors["lefort1"]["error_max"] == pytest.approx(2 * np.sin(np.radians(0.5)) * reach.max())
    assert errors["mandible_distal"] == {"error_mean": pytest.approx(5), "error_max": pytest.approx(5),
                                         "error_degrees": 0}  # fmt: skip


@pytest.mark.parametrize("virtual", [True, False])
def test_segments_are_judged_where_the_truth_is_known(tmp_path, virtual):
    files = {"fits": [], "achieved": [], "executed": [], "bones": []}
    for number, case in enumerate(("P1", "P2")):
        fits = [dict.fromkeys((c.name for c in FITS), 0.2) | {"case": case, "segment": name, "points": 9}
                for name in ("cranium", *NAMES[: number + 1])]  # fmt: skip
        plan = Plan(
            case, {name: RigidMotion(translation=np.array([0.2 + 0.3 * number, 0, 0])) for name in NAMES[: number + 1]}
        )
        for kind, write in (
            ("fits", lambda path, fits=fits: write_csv(pd.DataFrame(fits), path, FITS)),
            ("achieved", plan.write),
            ("executed", Plan(case, {}).write),
            ("bones", bone().write),
        ):
            path = tmp_path / f"{case}_{kind}{'.vtp' if kind == 'bones' else '.json'}"
            write(path)
            files[kind].append(path)
    chosen = files if virtual else {"fits": files["fits"]}
    table = tmp_path / "segments.csv"
    make(table, "pinnochio.tables.segments", **chosen, cases=["P1", "P2"], cohort="test cohort")
    made = read_table(table, SEGMENTS)
    assert len(made) == 5  # P1 has one segment, P2 two
    errors = made.set_index(["case", "segment"])["error_max"]
    text = table.with_suffix(".md").read_text()
    if virtual:
        assert errors["P1", "lefort1"] == pytest.approx(0.2) and errors["P2", "mandible_distal"] == pytest.approx(0.5)
        assert errors.isna().sum() == 2 and "1 of 2 patients" in text
    else:
        assert errors.isna().all() and "true motion" not in text
    assert "| Le Fort I | 2 |" in text and "| mandible distal | 1 |" in text
