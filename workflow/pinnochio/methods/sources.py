"""What bone motion does not explain of operated faces, learned as patterns of the face that mechanics carries.

Of a base, a field that says how the face follows the bone, training patients' scans show two things in which they are
alike: smooth patterns (:mod:`pinnochio.model.face_modes`) by which skin lies farther out or in, and by how much more or
less than the base it follows, the ratio of soft to hard tissue that surgeons know. One least-squares fit over the scans
of all finds both. A new patient's face is held there by springs (:mod:`pinnochio.mechanics.held_face`).
"""

import logging
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from pinnochio.geometry.closest_points import closest_points
from pinnochio.geometry.triangles import vertex_normals
from pinnochio.hdf5 import reading, writing
from pinnochio.model.face_modes import FaceModes
from pinnochio.model.patient import PatientModel

FOLLOWING = 6  # patterns, the broadest, of by how much more the skin follows [X]
USUAL = 3.0  # mm by which skin follows: so much more of it counts in the penalty as a millimetre outwards does [I]
PENALTY = 1.0  # on the square of each amplitude, mm: what one patient's whole face says in the fit [X]


@dataclass(frozen=True)
class SourceModel:
    """What a fold's training patients say of a new one.

    modes: the patterns; amplitudes (q + r,) mm: of patterns outwards, then of those of following `USUAL` more; largest:
    mm, what they say at most of a point of a training patient's face, beyond which none is moved.
    """

    modes: FaceModes
    amplitudes: np.ndarray
    largest: float

    def write(self, path: str | os.PathLike) -> None:
        """Write as HDF5."""
        with writing(path) as file:
            for name, value in self.state().items():
                file.create_dataset(name, data=value, track_times=False)

    @classmethod
    def read(cls, path: str | os.PathLike) -> "SourceModel":
        """Read what :meth:`write` wrote."""
        with reading(path) as file:
            return cls.restored({name: value[()] for name, value in file.items()})

    def state(self) -> dict[str, np.ndarray]:
        """Everything as arrays, by name."""
        return {name: np.asarray(value) for name, value in (vars(self.modes) | vars(self)).items() if name != "modes"}

    @classmethod
    def restored(cls, state: Mapping[str, np.ndarray]) -> "SourceModel":
        """From what :meth:`state` gave."""
        modes = FaceModes(*(state[name] for name in ("landmarks", "points", "even")))
        return cls(modes, state["amplitudes"], float(state["largest"]))


class PatientSources:
    """The learned sources of one patient, made once for every plan."""

    def __init__(self, learned: SourceModel, model: PatientModel):
        """InputError where the face cannot be read."""
        self._learned, self._onto, self._ways = learned, model.onto_judged, Ways(learned.modes, model)

    def __call__(self, base: np.ndarray) -> np.ndarray:
        """By how much (k, 3) mm the points of the judged face move beside the base (n, 3) mm, all of them less in
        proportion where one would by more than any of a training patient."""
        moved = self._ways(self._onto @ base) @ self._learned.amplitudes
        largest = np.linalg.norm(moved, axis=1).max()
        return moved * min(1.0, self._learned.largest / max(largest, 1e-9))


class Ways:
    """The ways in which one patient's judged face departs from a base, each of amplitude 1 mm."""

    def __init__(self, modes: FaceModes, model: PatientModel):
        """InputError where the face cannot be read."""
        self._patterns = modes(model)
        self._normals = vertex_normals(model.skin_points, model.skin_faces)[model.judged_points]

    def __call__(self, follows: np.ndarray) -> np.ndarray:
        """Displacements (k, 3, q + r) of its points, which the base moves by (k, 3) mm."""
        outwards = self._patterns[:, None, :] * self._normals[:, :, None]
        more = self._patterns[:, None, :FOLLOWING] * (follows / USUAL)[:, :, None]
        return np.concatenate([outwards, more], axis=2)


def fit(
    models: Sequence[PatientModel], bases: Sequence[np.ndarray], skins: Sequence[tuple[np.ndarray, np.ndarray]]
) -> SourceModel:
    """The model of some training patients: fields (n, 3) mm that bone motion causes, and post-operative skins."""
    modes = FaceModes.of(models)
    ways = [Ways(modes, model) for model in models]
    follows = [model.onto_judged @ base for model, base in zip(models, bases, strict=True)]
    square, pull, shown = 0.0, 0.0, 0.0
    for model, way, base, moved, skin in zip(models, ways, bases, follows, skins, strict=True):
        away, normals, weight = deviation(model, base, skin)
        outward = np.einsum("kxq,kx->kq", way(moved), normals)
        square = square + (outward.T * weight) @ outward
        pull = pull + (outward.T * weight) @ away
        shown += weight @ away**2
    amplitudes = np.linalg.solve(square + PENALTY * np.eye(len(square)), pull)
    said = (way(moved) @ amplitudes for way, moved in zip(ways, follows, strict=True))
    largest = max(np.linalg.norm(each, axis=1).max() for each in said)
    explained = (2 * pull - square @ amplitudes) @ amplitudes / max(shown, 1e-12)
    logging.info("sources explain %.2f of the square, at most %.1f mm", explained, largest)
    return SourceModel(modes, amplitudes, float(largest))


def deviation(model: PatientModel, base, skin: tuple) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """How a patient's post-operative skin (points, faces) deviates from the base (n, 3) mm at the points of the judged
    face: along the base's normals (k,) mm, these (k, 3), and weights (k,) by area, 0 where the scan ends."""
    moved, face = model.moved_skin(base), model.judged_points
    normals = vertex_normals(moved, model.skin_faces)[face]
    near = closest_points(moved[face], *skin)
    area = model.judged_areas * ~near.border
    return np.einsum("kx,kx->k", near.points - moved[face], normals), normals, area / area.sum()
