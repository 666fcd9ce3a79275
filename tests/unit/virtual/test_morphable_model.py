"""Scanned faces: distinct persons, a skull that fits, lips apart, an open nose, and jaws that take skin along."""

from itertools import combinations

import numpy as np
import pytest
import trimesh
from scipy import ndimage

from pinnochio.model.labels import AIR, CRANIUM, MUSCLE, SUPERFICIAL, segment_code
from pinnochio.seeds import generator
from pinnochio.virtual import head as head_module
from pinnochio.virtual.carry import anatomy
from pinnochio.virtual.cavities import airway
from pinnochio.virtual.head import CRUMB, SEGMENTS, build_head
from pinnochio.virtual.morphable_model import (
    DIMORPHISM,
    LIMIT,
    face_model,
    first_hit,
    make_face,
    sample_identity,
    solid,
)
from pinnochio.virtual.parameters import NORMAL
from pinnochio.virtual.procedures import DEFORMITIES, Procedure
from pinnochio.virtual.scanned import sample_patient
from pinnochio.virtual.skeleton import Skeleton
from pinnochio.virtual.thickness import measure
from studies.cohort_checks.thickness import summarise

SPACING = 1.5


def drawn(deformity):
    return sample_patient(generator(5, "faces", deformity), deformity)


@pytest.fixture(scope="module")
def heads():
    """One patient of each class."""
    return [build_head(drawn(deformity), SPACING) for deformity in DEFORMITIES]


def index(head, point):
    return tuple(np.round((point - head.origin) / head.spacing).astype(int))


def aligned(points):
    return points - points.mean(axis=0)


def test_persons_differ():
    """No two of twelve are alike to 1 mm, wherever their faces lie, and none is beyond the model's range."""
    front = face_model().mean[:, 1] < -40
    identities = [sample_identity(np.random.default_rng(n), n % 2 == 0) for n in range(12)]
    skins = [aligned(make_face(identity).points[front]) for identity in identities]
    apart = [np.sqrt(((a - b) ** 2).sum(axis=1).mean()) for a, b in combinations(skins, 2)]
    assert min(apart) > 1.0 and np.mean(apart) > 3
    assert identities[3] == sample_identity(np.random.default_rng(3), False)
    assert np.abs(np.array(identities)).max() < LIMIT + np.abs(face_model().male).max()


def test_women_and_men_differ_by_what_is_published():
    model = face_model()
    woman, man = (make_face(0.5 * side * model.male).points[model.corners] for side in (-1, 1))
    for (one, other), axis, size in DIMORPHISM:
        spans = [abs(face[one, axis] - face[other, axis]) for face in (woman, man)]
        assert spans[1] - spans[0] == pytest.approx(size, abs=0.01)


def test_the_mirror_image_of_a_person_is_one_of_the_model():
    """Its modes are even or odd: turning the sign of the odd ones mirrors the face."""
    model = face_model()
    left, right = model.corners[:17], model.corners[:17][::-1]
    odd = [np.abs(mode[left, 0] - mode[right, 0]).mean() < np.abs(mode[left, 0] + mode[right, 0]).mean()
           for mode in model.modes]  # fmt: skip
    assert 0 < np.sum(odd) < len(odd)
    identity = np.random.default_rng(1).normal(size=len(odd))
    face, mirrored = make_face(identity), make_face(np.where(odd, -identity, identity))
    assert np.allclose(face.points[left], mirrored.points[right] * [-1, 1, 1], atol=0.3)


def test_a_solid_has_the_volume_of_its_skin():
    ball = trimesh.creation.icosphere(subdivisions=4, radius=20.0)
    axes = [np.arange(-25, 26, 1.0)] * 3
    inside = solid(np.array(ball.vertices), np.array(ball.faces), axes)
    assert inside.sum() == pytest.approx(ball.volume, rel=0.02)
    x, y, z = np.meshgrid(*axes, indexing="ij")
    distance = np.sqrt(x**2 + y**2 + z**2)
    assert inside[distance < 19].all() and not inside[distance > 20.1].any()


def test_a_ray_meets_the_first_of_two_walls():
    ball = trimesh.creation.icosphere(subdivisions=4, radius=20.0)
    points, faces = np.array(ball.vertices), np.array(ball.faces)
    along = np.array([0.0, 0.6, 0.8])
    assert first_hit(points, faces, -50 * along, along) == pytest.approx(30, abs=0.1)
    assert np.isnan(first_hit(points, faces, np.array([30.0, -50, 0]), np.array([0.0, 1, 0])))


def test_every_label_is_one_component(heads):
    for head in heads:
        for code in (SUPERFICIAL, CRANIUM, *(segment_code(i) for i in range(len(SEGMENTS)))):
            segment = head.labels == code
            assert segment.sum() * SPACING**3 > 4000 and ndimage.label(segment)[1] == 1, code
        muscles = np.bincount(ndimage.label(head.labels == MUSCLE)[0].ravel())[1:] * SPACING**3
        assert muscles.sum() > 90_000 and muscles.min() > CRUMB and len(muscles) < 6
        assert ndimage.label(head.labels == AIR)[1] == 1


def test_the_nose_is_open_and_the_lips_part(heads):
    """Air reaches the throat through the nose with the mouth shut, and through the mouth with the nose shut."""
    for head in heads:
        s, air = Skeleton(head.parameters), head.labels == AIR
        axes = [start + SPACING * np.arange(count) for start, count in zip(head.origin, head.labels.shape, strict=True)]
        stomion = 0.5 * (head.landmarks["labrale_superius"] + head.landmarks["labrale_inferius"])
        throat = index(head, np.array([0, -10, -25.0]))
        assert air[throat]
        inside = (axes[1] > stomion[1] - 2)[:, None]
        shut = {
            "mouth": inside & (np.abs(axes[2] - stomion[2]) < 12),
            "nose": inside & (axes[2] > head.landmarks["subnasale"][2] - 3),
        }
        for name, wall in shut.items():
            parts, _ = ndimage.label(air & ~wall[None] | (air & (axes[1] > s.molar_y)[:, None]))
            assert parts[throat] == parts[0, 0, 0], name
        both, _ = ndimage.label(air & ~(shut["mouth"] | shut["nose"]) | (air & (axes[1] > s.molar_y)[:, None]))
        assert both[throat] != both[0, 0, 0]


def test_a_coarse_head_is_covered_by_two_voxels_and_its_chin_cut_off_in_one_piece(heads):
    for head in heads:
        cut = build_head(head.parameters, 2.0, Procedure(chin=True))
        forehead = cut.labels[:, :, int((head.landmarks["nasion"][2] + 8 - cut.origin[2]) / 2) :]
        outside = ndimage.label(forehead == AIR)[0] == 1
        assert not (ndimage.binary_dilation(outside, iterations=2) & (forehead >= CRANIUM)).any()
        assert cut.segments[-1] == "chin" and ndimage.label(cut.labels == segment_code(4))[1] == 1
        assert 2000 < (cut.labels == segment_code(4)).sum() * 8 < 12_000


def test_thickness_is_published_on_average(heads):
    frame = summarise([measure(head) for head in heads]).set_index("landmark")
    assert (frame["n"] == len(heads)).all()
    assert frame["difference_sd"].abs().max() < 1.5 and frame["difference_sd"].abs().mean() < 0.6


def test_bone_lies_below_the_skin(heads):
    """No bone but that behind the lips comes nearer to the outside than 2 mm."""
    for head in heads:
        front = ndimage.label(head.labels == AIR)[0] > 0
        depth = ndimage.distance_transform_edt(~front[:, :40], sampling=SPACING)
        mouth = np.abs(head.origin[2] + SPACING * np.arange(head.labels.shape[2]) - head.landmarks["upper_incisor"][2])
        seen = (head.labels[:, :40] >= CRANIUM) & (mouth > 14) & (depth < 2)
        assert seen.sum() < 0.004 * (head.labels >= CRANIUM).sum()


def test_landmarks_lie_on_the_skin_in_order(heads):
    names = ("nasion", "pronasale", "subnasale", "labrale_superius", "labrale_inferius", "pogonion_soft", "menton_soft")
    for head in heads:
        mark = head.landmarks
        assert (np.diff([mark[name][2] for name in names]) < 0).all()
        assert mark["tragus_left"][0] > mark["cheilion_left"][0] > 0 > mark["cheilion_right"][0]
        for name in names[:-1]:
            assert head.labels[index(head, mark[name] - [0, 1.5, 0])] == AIR
            assert head.labels[index(head, mark[name] + [0, 1.5, 0])] == SUPERFICIAL


def test_the_jaws_take_the_skin_along(heads):
    """The chin's skin goes with the chin, the forehead stays; teeth have the bite of the class."""
    for head in heads:
        p = head.parameters
        before, after = Skeleton(p.scanned.normal), Skeleton(p)
        was, now = make_face(p.scanned.identity).marks, anatomy(p).face.marks
        bone, skin = after.pogonion - before.pogonion, now["pogonion_soft"] - was["pogonion_soft"]
        assert np.linalg.norm(skin - bone) < 0.35 * np.linalg.norm(bone) + 0.5, p.deformity
        assert np.linalg.norm(now["glabella"] - was["glabella"]) < 0.3
        assert p.scanned.normal.deformity == NORMAL and p.scanned.normal.open_bite == 0
        assert np.allclose(before.condyle, after.condyle) and np.allclose(before.nasion, after.nasion)


def test_the_airway_is_the_wider_for_a_margin():
    s = Skeleton(drawn("class_ii"))
    nostrils = make_face(s.p.scanned.identity).nostrils
    for narrow, wide in zip(airway(s, nostrils), airway(s, nostrils, 1.0), strict=True):
        assert (wide.low < narrow.low - 0.9).all() and (wide.high > narrow.high + 0.9).all()


def test_the_same_draws_give_the_same_head(heads, monkeypatch):
    monkeypatch.setattr(head_module, "anatomy", anatomy.__wrapped__)
    again = build_head(drawn("asymmetry"), SPACING)
    assert np.array_equal(again.labels, heads[DEFORMITIES.index("asymmetry")].labels)
