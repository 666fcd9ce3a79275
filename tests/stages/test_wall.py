"""The wall between generator and methods: no pattern that a method may learn does to the skin what a term of the
outcome does."""

import numpy as np
import pytest

from pinnochio.geometry.triangles import vertex_normals
from pinnochio.mechanics.held_face import HeldFace
from pinnochio.model.face_modes import FaceModes
from pinnochio.model.patient import PatientModel
from pinnochio.virtual.aftermath import DECIDED, OPEN, RESPONSE, Circumstances, Site, read_landmarks
from pinnochio.virtual.covariates import Covariates
from pinnochio.virtual.published_thickness import PUBLISHED

ALIKE = 0.9
# A patient of whom every term says something.
OPERATED = Circumstances(
    4.0, 2.0, 4.0, 5.0, dict.fromkeys(PUBLISHED, 0.0), 2.0, Covariates("female", 35.0, 27.0, 6.0, "simple", False)
)


@pytest.fixture(scope="module")
def face(patient):
    """Model, skin points (k,) of the judged face, normals and root of the areas there."""
    model = PatientModel.read(patient.model)
    judged = model.judged_points
    area = model.judged_areas
    return model, judged, vertex_normals(model.skin_points, model.skin_faces)[judged], np.sqrt(area)


def responses(fields, face):
    """Unit vectors (q, k) of what fields (q, s, 3) of the skin do along its normals."""
    _, judged, normals, root = face
    outward = np.einsum("qkx,kx->qk", np.asarray(fields)[:, judged], normals) * root
    return outward / np.maximum(np.linalg.norm(outward, axis=1, keepdims=True), 1e-9)


def test_no_pattern_of_a_method_is_a_term_of_the_outcome(patient, face):
    model = face[0]
    site = Site(model.skin_points, (model.skin_points, model.skin_faces), read_landmarks(patient.landmarks))
    terms = {name: site.field(decide(OPERATED)) for name, decide in DECIDED.items()}
    for name in RESPONSE:
        terms[f"response {name}"] = site.field(dict.fromkeys(site.sides(name), 1.0))
    for name in ("lengthening", "gain"):
        moved = np.tile([0.0, -3, 1], (len(model.skin_points), 1))
        terms[name] = OPEN[name](site, moved, OPERATED, np.random.default_rng(0))

    held, outwards = HeldFace(model, patient.fem), FaceModes.of([model])(model)
    answers = [held.answer(pattern[:, None] * face[2]) for pattern in outwards.T]
    loads = [model.moved_skin(field) - model.skin_points for field in answers]
    alike = np.abs(responses(list(terms.values()), face) @ responses(loads, face).T)
    worst = {name: alike[row].max() for row, name in enumerate(terms)}
    assert max(worst.values()) < ALIKE, worst
    # The test sees a pattern that is a term.
    posed = responses([loads[0] + 0.1 * loads[1]], face) @ responses(loads[:1], face).T
    assert posed.item() > ALIKE
