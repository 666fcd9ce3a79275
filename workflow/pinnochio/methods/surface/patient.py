"""A patient as the surface networks and their losses read it."""

from dataclasses import dataclass, replace

import numpy as np
import torch
from scipy.spatial import cKDTree
from torch import Tensor

from pinnochio.geometry.closest_points import closest_points
from pinnochio.geometry.scattered import nearest, spread
from pinnochio.geometry.triangles import sample_surface, vertex_normals
from pinnochio.methods.surface.architectures import architecture, some
from pinnochio.methods.surface.settings import SurfaceSettings
from pinnochio.model.patient import PatientModel
from pinnochio.networks.clouds import SurfaceInputs, real
from pinnochio.plans.plan import Plan
from pinnochio.seeds import derive_seed

LOCAL = 5.0  # mm: pairs of points whose distance is to be kept [S: ACMT-Net]
TARGETS = 4  # target points for each point of the face, of which every step draws some


@dataclass(frozen=True)
class Draw:
    """Some points of a patient: what a network reads of them under no plan, and what the losses need.

    bone (b,): index of each bone point; near, weights (n, 3): nearest skin points of each face point, and their shares;
    pairs (p, 2) of face points close to each other.
    """

    inputs: SurfaceInputs
    bone: np.ndarray
    near: np.ndarray
    weights: np.ndarray
    pairs: Tensor


@dataclass(frozen=True)
class SurfacePatient:
    """A patient in the units of a network: x = (place - centre) / unit, in mm."""

    model: PatientModel
    centre: np.ndarray
    unit: float
    draws: tuple[Draw, ...]

    @classmethod
    def build(cls, model: PatientModel, settings: SurfaceSettings, case: str, repeats: int) -> "SurfacePatient":
        """`repeats` draws of the judged face and of the bone; the same for the same case."""
        face, local = np.unique(model.skin_faces[model.face_roi], return_inverse=True)
        faces, skin = local.reshape(-1, 3), model.skin_points[face]
        centre, kind, draws = skin.mean(axis=0), architecture(settings), []
        skin, bone = skin - centre, model.bone_points - centre
        unit = kind.unit(skin, bone)
        skin, bone = skin / unit, bone / unit
        normals = vertex_normals(skin, faces)
        for repeat in range(repeats):
            rng = np.random.default_rng(derive_seed(0, "surface points", f"{case}/{repeat}"))
            chosen = some(len(bone), settings.points, rng)
            shown = kind.face(skin, normals, faces, rng)
            code = kind.bone(bone[chosen], rng)
            points = shown.points.numpy()
            near, weights = nearest(points, skin)
            pairs = cKDTree(points).query_pairs(LOCAL / unit, output_type="ndarray")
            batch = torch.zeros(len(points), dtype=torch.int64)
            inputs = SurfaceInputs(shown, code, torch.zeros(len(chosen), 3), 1, batch)
            draws.append(Draw(inputs, chosen, face[near], weights, torch.as_tensor(pairs)))
        return cls(model, centre, unit, tuple(draws))

    def inputs(self, draw: Draw, plan: Plan) -> SurfaceInputs:
        """What a network reads of a draw under a plan."""
        moved = real(self.model.bone_displacement(plan)[draw.bone] / self.unit)
        return replace(draw.inputs, movement=moved)

    def carried(self, draw: Draw, skin: np.ndarray) -> Tensor:
        """Displacement (n, 3) in units of the face points of a draw where the skin points (s, 3) move so many mm."""
        return real(spread(skin, draw.near, draw.weights) / self.unit)


@dataclass(frozen=True)
class SurfaceTarget:
    """Points (t, 3) in units on the part of the post-operative skin that the judged face can be compared with.

    seen: for each draw, the weight (n,) of its face points, 0 where the scan has ended before, else 1.
    """

    points: Tensor
    seen: tuple[Tensor, ...]

    @classmethod
    def build(
        cls, patient: SurfacePatient, points: np.ndarray, faces: np.ndarray, settings: SurfaceSettings, case: str
    ) -> "SurfaceTarget":
        """Of the registered post-operative skin (p, 3) mm, (f, 3). ValueError if it covers nothing of the face.

        The rule is the metric's: what lies nearest to the judged face counts, and what ends on an open border does not.
        """
        model = patient.model
        many = sample_surface(points, faces, 3 * TARGETS * settings.points, derive_seed(0, "surface target", case))
        closest = closest_points(many, model.skin_points, model.skin_faces)
        many = many[model.face_roi[closest.face] & ~closest.border][: TARGETS * settings.points]
        if not len(many):
            raise ValueError("the post-operative skin covers nothing of the face: is it registered?")
        rests = (spread(model.skin_points, draw.near, draw.weights) for draw in patient.draws)
        seen = tuple(real(~closest_points(rest, points, faces).border) for rest in rests)
        return cls(real((many - patient.centre) / patient.unit), seen)
