"""How far the predicted skin is from the post-operative skin (definitions: methods dossier, section 5)."""

from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from pinnochio.errors import InputError
from pinnochio.geometry.closest_points import Closest, closest_points
from pinnochio.geometry.triangles import face_normals, sample_surface, vertex_areas


class Sampled(NamedTuple):
    """Samples (k, 3) mm of the target, their closest points on the prediction, which of them (k,) bool are judged."""

    queries: np.ndarray
    closest: Closest
    judged: np.ndarray


def surface_metrics(
    points,
    faces,
    roi,
    target_points,
    target_faces,
    samples: int,
    seed: int,
    case: str = "-",
    sampled: Sampled | None = None,
) -> dict[str, float]:
    """Metrics of a predicted skin against the registered target, in mm, mm2 (cd_sq) and % of area (pwr).

    points (p, 3), faces (f, 3): the predicted skin, whole; roi (f,) bool: the faces that are judged.
    Both directions compare one region. Prediction to target: points of the judged faces. Target to prediction: those
    points of the target whose closest point on the whole predicted skin lies on a judged face. Either way a point is
    dropped whose closest point lies on an open border of the other surface: there the other surface has simply ended.

    cd: half the sum of the two directed mean distances, point to triangle, unsquared; cd_sum: their sum; cd_sq: half
    the sum of the mean squares; cd_vertex: as cd, from vertex to nearest vertex. hd95, hdmax: the larger of the two
    directed 95th percentiles, maxima. hd_mean_oneway: mean over the target's vertices. pwr1, pwr2: share of the
    predicted area nearer than 1, 2 mm (a vertex owns a third of its triangles); _target: of the target's area.
    sampled: target_samples of the same arguments, if the caller has it.
    Raises InputError where the surfaces share no region.
    """
    faces, roi = np.asarray(faces), np.asarray(roi, bool)
    judged, used = faces[roi], np.unique(faces[roi])
    if not judged.size:
        raise InputError(case, "model", "no skin face is in the judged region", "check the segmentation's frame")

    def to_target(queries):
        closest = closest_points(queries, target_points, target_faces)
        return closest.distance, ~closest.border

    there, kept = to_target(sample_surface(points, judged, samples, seed))
    there = there[kept]
    sampled = sampled or target_samples(points, faces, roi, target_points, target_faces, samples, seed)
    back = sampled.closest.distance[sampled.judged]
    vertex_there, vertex_kept = to_target(points[used])
    target_used = np.unique(target_faces)
    closest, target_kept = on_judged(target_points[target_used], points, faces, roi)
    vertex_back = closest.distance
    if min(len(there), len(back), vertex_kept.sum(), target_kept.sum()) == 0:
        raise InputError(case, "postop", "the scan covers nothing of the judged face", "check scan and registration")

    areas = vertex_areas(points, judged)[used][vertex_kept]
    target_areas = vertex_areas(target_points, target_faces)[target_used][target_kept]
    vertex_there, vertex_back = vertex_there[vertex_kept], vertex_back[target_kept]
    pairs = (
        cKDTree(target_points[target_used]).query(points[used][vertex_kept])[0],
        cKDTree(points[np.unique(faces)]).query(target_points[target_used][target_kept])[0],
    )
    return {
        "cd": (there.mean() + back.mean()) / 2,
        "cd_sum": there.mean() + back.mean(),
        "cd_sq": ((there**2).mean() + (back**2).mean()) / 2,
        "cd_vertex": (pairs[0].mean() + pairs[1].mean()) / 2,
        "hd95": max(np.percentile(there, 95), np.percentile(back, 95)),
        "hdmax": max(there.max(), back.max()),
        "hd_mean_oneway": vertex_back.mean(),
        "pwr1": _share(vertex_there < 1, areas),
        "pwr2": _share(vertex_there < 2, areas),
        "pwr1_target": _share(vertex_back < 1, target_areas),
        "pwr2_target": _share(vertex_back < 2, target_areas),
    }


def target_samples(points, faces, roi, target_points, target_faces, samples: int, seed: int) -> Sampled:
    """Samples of the target and where they fall on the prediction.

    As many as leave about `samples` of them in the judged region; arguments and rule as in :func:`surface_metrics`.
    """
    ratio = face_normals(target_points, target_faces)[1].sum() / face_normals(points, faces[roi])[1].sum()
    many = int(np.ceil(samples * np.clip(ratio, 1, 5)))
    queries = sample_surface(target_points, target_faces, many, seed + 1)
    return Sampled(queries, *on_judged(queries, points, faces, roi))


def on_judged(queries, points, faces, roi) -> tuple[Closest, np.ndarray]:
    """Closest points of queries (k, 3) on the whole prediction, and which lie (k,) bool on its judged faces."""
    closest = closest_points(queries, points, faces)
    return closest, ~closest.border & roi[closest.face]


def _share(chosen, areas) -> float:
    return 100 * areas[chosen].sum() / areas.sum()
