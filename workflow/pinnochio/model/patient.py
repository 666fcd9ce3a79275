"""The patient as every method reads it: tetrahedra, interfaces and bone, in LPS millimetres."""

import os
from dataclasses import dataclass, fields

import numpy as np
from scipy import sparse
from scipy.spatial import cKDTree

from pinnochio.geometry.triangles import vertex_areas
from pinnochio.hdf5 import reading, writing
from pinnochio.plans.plan import Plan

# Node types: what the boundary condition of a node is.
FREE, FIXED, MOVING, SLIDING = 0, 1, 2, 3
# Interface kinds: which pair of bodies meets at a node.
NO_INTERFACE, BONE_MUSCLE, BONE_SUPERFICIAL, MUSCLE_SUPERFICIAL = 0, 1, 2, 3
# What lies beyond a boundary node: a label code (0 air, 10 cranium, 11.. segments) or one of these.
INTERIOR, CUT_PLANE = -1, 254
# Which lip a node of the mouth slit belongs to.
NOT_LIP, UPPER_LIP, LOWER_LIP = 0, 1, 2
SAME_PLACE = 1e-6  # mm; between copies of a point of the skin
ATTRIBUTES = ("segments", "muscle")  # what the file holds beside its arrays


@dataclass(frozen=True, eq=False)
class PatientModel:
    """Mesh, interfaces and bone surface of one patient.

    points (n, 3) mm; cells (m, 4) int32, positive volume; tissue (m,) int8 label code.
    node_type (n,) int8 FREE | FIXED | MOVING | SLIDING. A bone contact node is MOVING or SLIDING even where the plan
    happens to leave its segment in place; FIXED are cranium contact and cut planes.
    node_segment (n,) int8 segment index of moving and sliding nodes, else -1; -1 of a sliding node: on the cranium.
    node_beyond (n,) int16 INTERIOR, 0 air, 10 cranium, 11 + segment, CUT_PLANE.
    node_normal (n, 3) unit normal out of the tissue on boundary nodes, zero inside.
    interface_kind (n,) int8 NO_INTERFACE | BONE_MUSCLE | BONE_SUPERFICIAL | MUSCLE_SUPERFICIAL.
    skin_faces (f, 3) int32 outer skin triangles over skin_points (s, 3), outward; face_roi (f,) bool the part that
    accuracy is judged on. The skin is finer than the mesh and carried by it: skin_nodes (s, 3) int32 and
    skin_weights (s, 3) give the displacement of each of its points. By default it is the mesh's own boundary.
    bone_points (b, 3), bone_normals (b, 3) out of the bone, bone_faces (g, 3) int32.
    bone_segment (b,) int8 segment index, -1 cranium.
    segments: names of the case's own, in the order of the indices. muscle: where the muscle layer comes from
    (importing.muscle_layer): labelled | derived | single.
    lip (n,) int8 NOT_LIP | UPPER_LIP | LOWER_LIP: nodes that the other lip can touch; by default none.
    """

    points: np.ndarray
    cells: np.ndarray
    tissue: np.ndarray
    node_type: np.ndarray
    node_segment: np.ndarray
    node_beyond: np.ndarray
    node_normal: np.ndarray
    interface_kind: np.ndarray
    skin_faces: np.ndarray
    face_roi: np.ndarray
    bone_points: np.ndarray
    bone_normals: np.ndarray
    bone_faces: np.ndarray
    bone_segment: np.ndarray
    segments: tuple[str, ...]
    skin_points: np.ndarray | None = None
    skin_nodes: np.ndarray | None = None
    skin_weights: np.ndarray | None = None
    muscle: str = "labelled"
    lip: np.ndarray | None = None

    def __post_init__(self):
        if self.lip is None:
            object.__setattr__(self, "lip", np.full(len(self.points), NOT_LIP, np.int8))
        if self.skin_points is None:
            count = len(self.points)
            nodes = np.repeat(np.arange(count, dtype=np.int32)[:, None], 3, axis=1)
            defaults = {
                "skin_points": self.points,
                "skin_nodes": nodes,
                "skin_weights": np.tile([1.0, 0, 0], (count, 1)),
            }
            for name, value in defaults.items():
                object.__setattr__(self, name, value)

    def moved_skin(self, displacement: np.ndarray) -> np.ndarray:
        """Points of the outer skin (s, 3) mm under a displacement (n, 3) mm of the mesh."""
        return self.skin_points + np.einsum("sc,scx->sx", self.skin_weights, displacement[self.skin_nodes])

    def skin_at(self, places) -> np.ndarray:
        """Index (k,) of the skin point at each place (k, 3) mm, -1 where there is none, or one of each lip: the models
        of a case copy their skin from one surface, and each parts the lips for itself."""
        away, nearest = cKDTree(self.skin_points).query(places, 2)
        return np.where((away < SAME_PLACE).sum(axis=1) == 1, nearest[:, 0], -1)

    @property
    def judged_points(self) -> np.ndarray:
        """Indices (k,) of the skin points of the judged face, ascending."""
        return np.unique(self.skin_faces[self.face_roi])

    @property
    def judged_areas(self) -> np.ndarray:
        """Area (k,) mm^2 of the judged face that each of its points stands for, at rest."""
        return vertex_areas(self.skin_points, self.skin_faces[self.face_roi])[self.judged_points]

    @property
    def onto_judged(self) -> sparse.csr_array:
        """From values at the nodes to those at the points of the judged face, (k, n)."""
        face = self.judged_points
        rows = np.repeat(np.arange(len(face)), 3)
        entries = self.skin_weights[face].ravel(), (rows, self.skin_nodes[face].ravel())
        return sparse.csr_array(entries, (len(face), len(self.points)))

    def reference_cue(self, plan: Plan) -> tuple[np.ndarray, np.ndarray]:
        """Cue c_ref (n, 3) mm and reliability mask (n,) bool of the nodes whose motion the plan fixes.

        Zero on fixed nodes, the rigid motion of the segment on moving ones; sliding and free nodes carry zero and
        an unset mask, because nothing is known of them.
        """
        cue = np.zeros_like(self.points)
        for index, name in enumerate(self.segments):
            nodes = (self.node_type == MOVING) & (self.node_segment == index)
            cue[nodes] = plan.motion(name).displacement(self.points[nodes])
        return cue, (self.node_type == FIXED) | (self.node_type == MOVING)

    def bone_displacement(self, plan: Plan) -> np.ndarray:
        """Displacement (b, 3) mm of the bone surface under the plan; zero on the cranium."""
        moved = np.zeros_like(self.bone_points)
        for index, name in enumerate(self.segments):
            of_segment = self.bone_segment == index
            moved[of_segment] = plan.motion(name).displacement(self.bone_points[of_segment])
        return moved

    def write(self, path: str | os.PathLike) -> None:
        """Write the model as HDF5, one dataset per array; names and words as attributes."""
        with writing(path) as file:
            for item in fields(self):
                value = getattr(self, item.name)
                if item.name in ATTRIBUTES:
                    file.attrs[item.name] = value
                else:
                    file.create_dataset(item.name, data=value, compression="gzip", track_times=False)

    @classmethod
    def read(cls, path: str | os.PathLike) -> "PatientModel":
        """Read what :meth:`write` wrote."""
        with reading(path) as file:
            arrays = {item.name: file[item.name][()] for item in fields(cls) if item.name not in ATTRIBUTES}
            segments = tuple(str(name) for name in file.attrs["segments"])
            return cls(**arrays, segments=segments, muscle=str(file.attrs["muscle"]))
