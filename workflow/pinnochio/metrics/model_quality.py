"""How good a patient's model is: volumes, thickness, contact, elements, detail of the skin, repairs."""

from collections.abc import Mapping

import numpy as np

from pinnochio.geometry.closest_points import closest_points
from pinnochio.geometry.mesh_topology import EDGES
from pinnochio.geometry.triangles import vertex_areas
from pinnochio.importing.repair import repaired_voxels
from pinnochio.meshing.mesh import TetMesh
from pinnochio.metrics.judged import known_regions
from pinnochio.model.labels import CRANIUM, segment_code
from pinnochio.model.patient import FIXED, FREE, MOVING, SLIDING, PatientModel
from pinnochio.model.regions import NAMES

# What a contact node does; tissue at an osteotomy is released from its bone, so its nodes are free.
CONTACT = {"fixed": FIXED, "moving": MOVING, "sliding": SLIDING, "released": FREE}
TOWARDS_SKIN = 0.5  # cosine between bone normal and the way to the skin where thickness is measured [I]
BARE = 1.0  # mm of tissue that count as none
DETAIL = 1.0  # mm between skin and mesh up to which the mesh has the form of the skin [I]


def quality(patient: PatientModel, imported: Mapping) -> dict:
    """What is known of a patient before anything is computed, as JSON holds it.

    imported: the import's report (case, muscle, volume_cm3, repairs; warnings, care and cuts where there are some).
    """
    mesh = TetMesh(patient.points, patient.cells, patient.tissue)
    corners = patient.points[patient.cells[:, EDGES]]
    return {
        "case": imported["case"],
        "muscle": patient.muscle,
        "repaired_voxels": repaired_voxels(imported["repairs"]),
        "repairs": imported["repairs"],
        "nodes": len(patient.points),
        "elements": len(patient.cells),
        "smallest_dihedral_deg": round(float(mesh.dihedral_angles().min()), 3),
        "smallest_volume_mm3": round(float(mesh.volumes().min()), 5),
        "shortest_edge_mm": round(float(np.linalg.norm(corners[:, :, 0] - corners[:, :, 1], axis=2).min()), 4),
        "volume_cm3": dict(imported["volume_cm3"]),
        "thickness_mm": thickness(patient),
        "contact_cm2": contact(patient),
        **{name: imported.get(name, []) for name in ("warnings", "care", "cuts")},
    }


def thickness(patient: PatientModel) -> dict[str, dict[str, float] | None]:
    """Mean, 5th and 95th percentile (mm) of the soft tissue over each bone; None where no bone faces the skin.

    Measured from the bone surface's points to the nearest point of the skin, where that lies in front of the bone
    (TOWARDS_SKIN), not on the border of the skin, and at least BARE away: nearer, the skin is the bone's own surface.
    """
    skin = closest_points(patient.bone_points, patient.skin_points, patient.skin_faces)
    way = skin.points - patient.bone_points
    facing = np.einsum("bx,bx->b", way, patient.bone_normals) > TOWARDS_SKIN * skin.distance
    facing &= (skin.distance > BARE) & ~skin.border
    measured = {}
    for name, index in _bones(patient):
        distances = skin.distance[(patient.bone_segment == index) & facing]
        low, high = np.percentile(distances, [5, 95]) if len(distances) else (np.nan, np.nan)
        values = {"mean": distances.mean(), "p5": low, "p95": high} if len(distances) else None
        measured[name] = values and {key: round(float(value), 3) for key, value in values.items()}
    return measured


def contact(patient: PatientModel) -> dict[str, dict[str, float]]:
    """Area (cm2) of the tissue's boundary on each bone, by what its nodes do; a node has a third of its triangles."""
    faces, _ = TetMesh(patient.points, patient.cells, patient.tissue).boundary_faces()
    areas = vertex_areas(patient.points, faces) / 100
    touched = {}
    for name, index in _bones(patient):
        on_bone = patient.node_beyond == (CRANIUM if index < 0 else segment_code(index))
        touched[name] = {
            kind: round(float(areas[on_bone & (patient.node_type == code)].sum()), 4)
            for kind, code in CONTACT.items()
            if code not in ((MOVING,) if index < 0 else (FIXED,))
        }
    return touched


def off_mesh(patient: PatientModel) -> dict[str, float | dict[str, float]]:
    """How far the judged face lies from the mesh that carries it, mm: mean, and below which 95 % of its points lie.

    Of each region the latter too, where it is beyond DETAIL, the farthest first; none where no region can be told.
    Form that the mesh lacks, such as the edges of the lips, rides on the tissue beneath: it is shown, not computed.
    """
    carrier = np.einsum("sc,scx->sx", patient.skin_weights, patient.points[patient.skin_nodes])
    distance, codes = np.linalg.norm(carrier - patient.skin_points, axis=1), known_regions(patient)
    face = distance[patient.judged_points]
    largest = {
        name: np.percentile(distance[codes == code], 95) for code, name in enumerate(NAMES) if (codes == code).any()
    }
    beyond = sorted((name for name in largest if largest[name] > DETAIL), key=largest.get, reverse=True)
    return {
        "off_mesh_mean_mm": face.mean(),
        "off_mesh_p95_mm": np.percentile(face, 95),
        "off_mesh_regions_mm": {name: largest[name] for name in beyond},
    }


def _bones(patient: PatientModel) -> list[tuple[str, int]]:
    return [("cranium", -1), *((name, index) for index, name in enumerate(patient.segments))]
