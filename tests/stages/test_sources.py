"""Loads that are learned: what scans hold of a known load is found again."""

import numpy as np
import pytest

from pinnochio.geometry.triangles import vertex_normals
from pinnochio.methods.sources import ANCHORS, Deviation, PatientSources, fit, sources_of
from pinnochio.model.patient import PatientModel
from pinnochio.plans.plan import Plan


@pytest.fixture(scope="module")
def faces(patients):
    """Two patients' models and plans."""
    models = [PatientModel.read(files.model) for files in patients]
    return models, [Plan.read(files.plan, files.case) for files in patients]


@pytest.fixture(scope="module")
def unloaded(patients, faces):
    """What is learned of faces that are as finite elements say, and each patient's sources."""
    models, plans = faces
    model = learned(patients, faces, [0 * head.points for head in models])
    return model, [sources_of(head, model.anchors, model.landmarks, patients[0].fem) for head in models]


def learned(patients, faces, fields):
    """The model of skins that the fields (n, 3) mm move, from bases that are zero."""
    models, plans = faces
    skins = [(head.moved_skin(field), head.skin_faces) for head, field in zip(models, fields, strict=True)]
    return fit(models, [0 * head.points for head in models], plans, skins, [{}, {}], patients[0].fem)


def on_face(head, field):
    return (head.moved_skin(field) - head.skin_points)[head.judged_points]


@pytest.mark.parametrize("turn", [0.5, -0.4])
def test_a_turn_of_the_weight_is_learned(patients, faces, unloaded, turn):
    """And nothing where nothing deviates."""
    assert abs(unloaded[0].weight) < 1e-9 and unloaded[0].regression.form == "zero"
    amplitudes = np.append(np.zeros(2 * ANCHORS), turn)
    fields = [sources.field(amplitudes) for sources in unloaded[1]]
    model = learned(patients, faces, fields)
    assert model.weight == pytest.approx(turn, rel=0.03)
    for head, plan, field in zip(*faces, fields, strict=True):
        sources = PatientSources(model, head, patients[0].fem, {})
        off = on_face(head, sources.sources.field(sources.amplitudes(plan)) - field)
        assert np.linalg.norm(off) < 0.03 * np.linalg.norm(on_face(head, field))


def test_pressures_under_the_skin_are_read_from_a_scan(faces, unloaded):
    """One patient's, one at each anchor, beside a known turn of the weight; along the normals."""
    (head, _), (sources, _) = faces[0], unloaded[1]
    amplitudes = np.append(0.2 * np.random.default_rng(0).normal(size=2 * ANCHORS), 0.1)
    field = sources.field(amplitudes)
    scan = head.moved_skin(field), head.skin_faces
    read = Deviation.of(head, 0 * head.points, scan, sources).amplitudes(0.1)
    normals = vertex_normals(head.skin_points, head.skin_faces)[head.judged_points]
    shown, left = (
        np.einsum("kx,kx->k", on_face(head, each), normals)
        for each in (field, sources.field(np.append(read, 0.1)) - field)
    )
    assert np.linalg.norm(left) < 0.2 * np.linalg.norm(shown)
    assert np.corrcoef(read, amplitudes[:-1])[0, 1] > 0.8
