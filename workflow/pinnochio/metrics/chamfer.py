"""How far the predicted skin is from the post-operative skin (definitions: methods dossier, section 5)."""

import numpy as np
from scipy.spatial import cKDTree

from pinnochio.geometry.closest_points import closest_points


def surface_metrics(
    points, faces, skin, target_points, target_faces, samples, back: np.ndarray | None = None
) -> dict[str, float]:
    """Metrics of a predicted skin against the registered target, in mm, mm2 (cd_sq) and % of samples (pwr).

    points (p, 3), faces (f, 3): the predicted skin, whole; skin (j, 3): where it takes the samples of the judged skin;
    samples (k, 3): those of the target. Both are the same for every method of a case
    (:class:`pinnochio.metrics.judged.Judged`), area-uniform, and all of them count: also those whose closest point lies
    on an open border, for a prediction that ends too early is wrong there. back (k,): distances of the target's samples
    from the predicted skin, where they are known already.

    cd: half the sum of the two directed mean distances, point to triangle, unsquared; cd_sum: their sum; cd_sq: half
    the sum of the mean squares; cd_vertex: as cd, to the nearest vertex. hd95, p99, hdmax: the larger of the two
    directed 95th and 99th percentiles, maxima. hd_mean_oneway: mean over the target. pwr1, pwr2: share of the skin's
    samples nearer than 1, 2 mm; _target: of the target's.
    """
    there = closest_points(skin, target_points, target_faces).distance
    back = closest_points(samples, points, faces).distance if back is None else back
    pairs = (
        cKDTree(target_points[np.unique(target_faces)]).query(skin)[0],
        cKDTree(points[np.unique(faces)]).query(samples)[0],
    )
    return {
        "cd": (there.mean() + back.mean()) / 2,
        "cd_sum": there.mean() + back.mean(),
        "cd_sq": ((there**2).mean() + (back**2).mean()) / 2,
        "cd_vertex": (pairs[0].mean() + pairs[1].mean()) / 2,
        "hd95": max(np.percentile(there, 95), np.percentile(back, 95)),
        "p99": max(np.percentile(there, 99), np.percentile(back, 99)),
        "hdmax": max(there.max(), back.max()),
        "hd_mean_oneway": back.mean(),
        "pwr1": 100 * (there < 1).mean(),
        "pwr2": 100 * (there < 2).mean(),
        "pwr1_target": 100 * (back < 1).mean(),
        "pwr2_target": 100 * (back < 2).mean(),
    }
