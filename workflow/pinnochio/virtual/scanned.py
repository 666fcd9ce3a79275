"""Patients with the face of the model of scanned persons: the skull's numbers that suit the face, and its deformity."""

from dataclasses import replace

import numpy as np
from scipy.stats import norm

from pinnochio.plans.sampling import quantile, truncated
from pinnochio.virtual.morphable_model import ModelFace, first_hit, make_face, sample_identity
from pinnochio.virtual.parameters import NORMAL, TABLE, Anchors, HeadParameters, Scanned, distribution
from pinnochio.virtual.procedures import DEFORMITIES
from pinnochio.virtual.published_thickness import PUBLISHED
from pinnochio.virtual.rays import REACH, sites
from pinnochio.virtual.skeleton import Skeleton

DRAWN = ("mandible_length", "ramus_height", "gonial_angle", "chin_width", "brow_prominence")  # with the thicknesses
OVERJETS = (1.0, 4.0)  # mm of a normal bite, within which the lower lip's thickness decides [R]
LABIAL = 1.5  # mm from the upper incisor's labial face, at the height of the lip's border, to its edge [I]
STEEPEST = 9.0  # mm of the incisors ahead of the A point at most [I]
SPINE = 1.5  # mm by which the bone below the nasal spine lies ahead of the A point, as modelled
FORWARD_SD = 1.0  # mm by which the maxilla's growth differs from its class's [I]
ALIKE = 0.5  # correlation of the thicknesses of one face [I]
CHIN_BACK = 0.5  # mm by which the chin falls back per mm of open bite, the mandible turning about its condyles [I]


def sample_patient(rng: np.random.Generator, deformity: str) -> HeadParameters:
    """Draw one patient of a deformity class: a person, and what the deformity made of the person's jaws.

    ValueError for a class that is none of DEFORMITIES.
    """
    if deformity not in DEFORMITIES:
        raise ValueError(f"unknown deformity {deformity!r}; choose one of {', '.join(DEFORMITIES)}")
    male = bool(rng.random() < 0.5)
    side = 1.0 if rng.random() < 0.5 else -1.0
    identity = sample_identity(rng, male)
    values, thick = {name: truncated(rng, *distribution(name, male, NORMAL)) for name in DRAWN}, rng.normal()
    for name in PUBLISHED:
        alike = norm.cdf(np.sqrt(ALIKE) * thick + np.sqrt(1 - ALIKE) * rng.normal())
        values[name] = quantile(alike, *distribution(name, male, NORMAL))
    return deform(rng, fit(identity, male, values), deformity, side)


def fit(identity: tuple[float, ...], male: bool, values: dict[str, float]) -> HeadParameters:
    """The normal person: the skull's numbers from the skin, by the drawn thicknesses of `values`, and from the teeth.

    values: those of DRAWN and the thicknesses; places and sizes are the face's. The sagittal place of the upper
    incisors is that of the upper lip less its thickness; height and arch are those of the model's teeth.
    """
    face = make_face(identity)
    m, t = face.marks, values
    nasion, depth = m["nasion"][2], -(m["nasion"][1] + t["nasion"])
    menton = m["menton_soft"][2] + t["menton"]
    height, chin = nasion - menton, m["pogonion_soft"] + [0, t["pogonion"], -1]
    spine, a_point = m["subnasale"][2] + 1, m["subnasale"][1] + t["subnasale"] + SPINE
    upper = m["labrale_superius"][1] + t["labrale_superius"] - LABIAL
    steep = 0.5 * max(a_point - upper - STEEPEST, 0.0)  # lip and base of the nose share what is too much for bone
    a_point, upper = a_point - steep, upper + steep
    overjet = float(np.clip(m["labrale_inferius"][1] + t["labrale_inferius"] - LABIAL - upper, *OVERJETS))
    teeth, edges = face.teeth["upper_teeth"], face.teeth["upper_edges"]
    anchors = Anchors(
        tall=height / 119.0,
        nasion=nasion,
        spine=spine,
        incisor=float(edges[7:9, 2].mean()),
        incisor_ahead=a_point - upper,
        arch_half_width=float(np.abs(teeth[[1, 14], 0]).mean()),
        arch_depth=float(teeth[[1, 14], 1].mean() + 5.0 - teeth[7:9, 1].mean()),
        chin_height=chin[2] - menton,
    )
    numbers = values | {
        "face_height": height,
        "lower_share": (spine - menton) / height,
        "face_width": _cheek_width(face),
        "face_depth": depth,
        "maxilla_position": -depth - a_point,
        "overjet": overjet,
        "open_bite": 0.0,
        "gonial_width": TABLE["gonial_width"].mean,
        "chin_prominence": upper + overjet + 7.0 - chin[1],
        "chin_deviation": 0.0,
        "occlusal_cant": 0.0,
        "eye_spacing": float(face.eyes[0, 0] - face.eyes[1, 0]),
    }
    numbers = {name: round(float(value), 4) for name, value in numbers.items()}
    anchors = Anchors(**{name: round(float(value), 4) for name, value in vars(anchors).items()})
    normal = HeadParameters(deformity=NORMAL, male=male, scanned=Scanned(identity, anchors), **numbers)
    return replace(normal, gonial_width=_gonial_width(normal, face))


def _cheek_width(face: ModelFace) -> float:
    """Width (mm) across the cheeks in front of the ears."""
    p = face.points
    cheek = (p[:, 1] > -70) & (p[:, 1] < -18) & (np.abs(p[:, 2]) < 15)
    return float(2 * np.quantile(np.abs(p[cheek, 0]), 0.98))


def _gonial_width(normal: HeadParameters, face: ModelFace) -> float:
    """Width (mm) between the gonia that leaves the masseter's thickness over the middle of the ramus."""
    s = Skeleton(normal)
    lateral = []
    for ray in sites(s, face.marks)["masseter"]:
        outside = ray.target - 2 * REACH * ray.inward
        skin = outside + first_hit(face.points, face.triangles, outside, ray.inward) * ray.inward
        lateral.append(abs(skin[0]) - normal.masseter)
    # The ramus there lies half way between gonion and condyle, as `mandible` models it.
    return round(float(np.clip(2 * (2 * np.mean(lateral) - s.condyle[0] - 0.2), 72, 116)), 4)


def deform(rng: np.random.Generator, normal: HeadParameters, deformity: str, side: float) -> HeadParameters:
    """The patient: the normal person's jaws moved and grown as the deformity has it; cranium and identity stay."""
    male, n = normal.male, normal

    def drawn(name):
        return truncated(rng, *distribution(name, male, deformity))

    def grown(name):
        return getattr(n, name) + distribution(name, male, deformity)[0] - distribution(name, male, NORMAL)[0]

    forward = grown("maxilla_position") + FORWARD_SD * truncated(rng, 0, 1, -2, 2)
    overjet, open_bite, deviation, cant = map(drawn, ("overjet", "open_bite", "chin_deviation", "occlusal_cant"))
    if deformity == "asymmetry":  # the chin deviates away from the longer, lower side
        deviation, cant = deviation * side, -cant * side
    opened = max(open_bite, 0.0)
    changed = {
        "maxilla_position": forward,
        "overjet": overjet,
        "open_bite": open_bite,
        "chin_deviation": deviation,
        "occlusal_cant": cant,
        "face_height": n.face_height + opened,
        "chin_prominence": n.chin_prominence - CHIN_BACK * opened,
        **{name: grown(name) for name in ("mandible_length", "ramus_height", "gonial_angle")},
    }
    changed = {name: round(float(value), 4) for name, value in changed.items()}
    scanned = Scanned(n.scanned.identity, n.scanned.anchors, normal)
    return replace(normal, deformity=deformity, scanned=scanned, **changed)
