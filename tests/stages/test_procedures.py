"""Cases that are cut differently through the stages: one jaw, an uncut mandible, a maxilla in pieces."""

import json
from collections import Counter

import h5py
import numpy as np
import pytest

from pinnochio.mechanics.elements.tetrahedra import jacobians
from pinnochio.mechanics.settings import FemSettings
from pinnochio.mechanics.simulation import simulate
from pinnochio.methods.ratio import RatioRule
from pinnochio.model.patient import FIXED, LOWER_LIP, MOVING, SLIDING, UPPER_LIP, PatientModel
from pinnochio.plans.plan import Plan
from pinnochio.virtual.procedures import MANDIBLE, MAXILLA, Procedure
from scripts.fem.simulate_fem import simulate_fem
from tests.helpers.coarse_head import modelled
from tests.helpers.settings import CONFIG, SEED

FEM = FemSettings(**CONFIG["fem"])
KINDS = {
    "mandible_only": (0, Procedure(MANDIBLE, chin=True)),
    "maxilla_only": (3, Procedure(MAXILLA)),
    "segmental": (2, Procedure(pieces=3, chin=True)),
}


@pytest.fixture(
    scope="module", params=["mandible_only", pytest.param("maxilla_only", marks=pytest.mark.full), "segmental"]
)
def case(request, tmp_path_factory):
    """Folder, procedure and model of a patient that went through import, mesher and interfaces."""
    (number, procedure), folder = KINDS[request.param], tmp_path_factory.mktemp(request.param)
    files = modelled(request.param, number, folder, procedure, 900)
    return folder, procedure, PatientModel.read(files["model"])


def test_a_case_has_the_segments_of_its_cuts_in_the_order_of_the_vocabulary(case):
    folder, procedure, model = case
    assert model.segments == tuple(name for name in CONFIG["segments"] if name in procedure.segments)
    report = json.loads((folder / "report.json").read_text())
    assert set(report["volume_cm3"]) == {"superficial", "muscle", "cranium", *model.segments}
    assert Counter(model.bone_segment.tolist()).keys() == {-1, *range(len(model.segments))}
    assert set(json.loads((folder / "plan.json").read_text())["segments"]) == set(model.segments)


def test_the_jaws_slide_past_each_other_whichever_is_cut(case):
    _, procedure, model = case
    kinds = np.bincount(model.node_type, minlength=4)
    assert kinds[[FIXED, MOVING, SLIDING]].min() > 5
    sliding = {(-1 if code < 0 else model.segments[code]) for code in model.node_segment[model.node_type == SLIDING]}
    lower = "mandible" if procedure.jaws == MAXILLA else "mandible_distal"
    assert lower in sliding
    assert (-1 in sliding) == (procedure.jaws == MANDIBLE)  # its upper teeth are cranium
    assert min((model.lip == lip).sum() for lip in (UPPER_LIP, LOWER_LIP)) > 2


def test_its_plan_and_sampled_ones_are_solved(case):
    folder, procedure, model = case
    name = next(name for name, (_, kind) in KINDS.items() if kind == procedure)
    plan = Plan.read(folder / "plan.json", name)
    for arm in ("bonded", "mucosa"):
        (result,) = simulate(model, [plan], FEM, arm=arm)
        assert result.converged and jacobians(model.points, model.cells, result.displacement).min() > 0
    files = [str(folder / file) for file in ("model.h5", "plan.json", "samples.h5")]
    simulate_fem(name, *files[:2], 2, FEM, SEED, files[2])
    with h5py.File(folder / "samples.h5") as samples:
        for group in samples.values():
            assert set(Plan.from_json(group.attrs["plan"]).motions) == set(model.segments)
    assert 0.5 < np.abs(RatioRule(model)(plan)).max() < 20
