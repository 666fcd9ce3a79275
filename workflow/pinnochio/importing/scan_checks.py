"""What a post-operative scan may be: made handy and free of spikes before it is registered, and judged after."""

import logging

import numpy as np
from scipy.spatial import cKDTree

from pinnochio.errors import InputError, refusal
from pinnochio.geometry.closest_points import closest_points
from pinnochio.geometry.triangles import vertex_normals
from pinnochio.importing.registration import SAMPLES, Registration, middle_of_face, registered_again, spread

LOG = logging.getLogger(__name__)
SPIKE = 20.0  # mm from the middle of its neighbours; no part of a face is so thin
SPIKES = 0.01  # share of the points above which a scan is no face with a few faults
MANY = 600_000  # triangles; more show a face no better and take minutes
CELL = 0.5  # mm; points in one cell of this size become one
THINNING = 0.1  # mm; what 95 of 100 places of the scan, each the mean of AROUND points, may lie off the thinned surface
PLACES, AROUND = 2000, 32
THE_SAME = 0.02  # mm; no scanner repeats a face so well [I]
MIRROR_BETTER = 0.93  # share of the residual below which the mirror image fits better than the scan
# Share of the residual that a scale leaves where the scan's is wrong, and by how much it is then wrong at least: the
# share is 0.93 to 1.0 of virtual patients' scans, half of one too, and 0.5 of one that is 2 % too small or large [X].
SCALED_BETTER, SCALE = 0.7, 0.02
DEPTH = 3.0  # mm; standard deviation of the upper face across its flattest direction: a strip of forehead has 5
COVERED, SHOWN = 0.15, 3.0  # share of the upper face that a scan must show, within so many mm
OFF = 2.0  # mm from the scan of half of the upper face that it lies over: 0.2 to 0.9 of faces, 2.9 of a cylinder [X]
# The bridge of the nose and the eyes' inner corners: mm below and above the plane, mm from the middle; the share of it
# that a scan must show within so many mm: 0.8 to 1 of scans, 0.4 of half of one, 0.2 at most of other surfaces [X].
BELOW, ABOVE, BESIDE = 25.0, 10.0, 35.0
BRIDGE, NEAR = 0.3, 5.0
FAR = 10.0  # length of edges by the distance of next points, above which triangles are no surface [I]
FRONT = -0.3  # y of a normal that looks forward (LPS)


def without_spikes(points, faces, case: str, file: object) -> tuple[np.ndarray, np.ndarray]:
    """The surface without the points that stand off from all around them; InputError where these are many."""
    first = len(points)
    for _ in range(10):  # a spike of several points has a middle of its own
        total, count = np.zeros_like(points), np.zeros(len(points))
        for corner in range(3):
            for other in (1, 2):
                np.add.at(total, faces[:, corner], points[faces[:, (corner + other) % 3]])
            count += 2 * np.bincount(faces[:, corner], minlength=len(points))
        off = np.linalg.norm(total / np.maximum(count, 1)[:, None] - points, axis=1)
        edges = np.linalg.norm(points[faces] - points[np.roll(faces, 1, axis=1)], axis=2)
        limit = max(SPIKE, 10 * float(np.median(edges)))
        if not ((count > 0) & (off > limit)).any():
            break
        # The neighbours of a spike stand off from it too: of those beside each other the farthest goes.
        farthest = np.zeros(len(points))
        for corner in range(3):
            np.maximum.at(farthest, faces[:, corner], off[faces].max(axis=1))
        keep = (off <= limit) | (off < farthest)
        used, faces = np.unique(faces[keep[faces].all(axis=1)], return_inverse=True)
        points, faces = points[used], faces.reshape(-1, 3).astype(np.int32)
    lost = first - len(points)
    if lost:
        LOG.warning("case %r: %s: %d of %d points are or hold spikes and are left out", case, file, lost, first)
    if not lost <= max(SPIKES * first, 20):
        problem = f"{lost} of its {first} points stand off from all around them by more than {SPIKE:g} mm"
        raise InputError(case, file, problem, "clean the scan and export it again")
    return points, faces


def check_joined(points, faces, case: str, file: object) -> None:
    """Refuse (InputError) triangles that join points far from each other, as where the order of points is lost."""
    edges = np.linalg.norm(points[faces] - points[np.roll(faces, 1, axis=1)], axis=2)
    edge = float(np.median(edges.min(axis=1)))
    some = points[:: max(1, len(points) // 10_000)]
    apart = float(np.median(cKDTree(points).query(some, 2)[0][:, 1]))
    if not edge <= FAR * apart:
        problem = f"its triangles join points {edge:.3g} mm apart, and points lie {apart:.3g} mm from the next"
        raise InputError(case, file, problem, "export the scan again as one surface")


def thinned(points, faces, case: str, file: object) -> tuple[np.ndarray, np.ndarray]:
    """A surface of at most MANY triangles; the distance of the scan's points from it is measured and stated.

    Points in one cell of a grid become their mean. InputError where that takes detail away, which is what the scan
    lies off where its noise is averaged out.
    """
    if len(faces) <= MANY:
        return points, faces
    whole, size, triangles = points, CELL, len(faces)
    while len(faces) > MANY:
        cells = np.floor((points - points.min(axis=0)) / size).astype(np.int64)
        key = (cells[:, 0] << 42) | (cells[:, 1] << 21) | cells[:, 2]
        _, cell, count = np.unique(key, return_inverse=True, return_counts=True)
        points = np.stack([np.bincount(cell, points[:, axis]) for axis in range(3)], axis=1) / count[:, None]
        faces = cell[faces].astype(np.int32)
        faces = faces[(faces != np.roll(faces, 1, axis=1)).all(axis=1)]
        _, once = np.unique(np.sort(faces, axis=1), axis=0, return_index=True)
        faces = faces[np.sort(once)]
        size *= 1.4
    some = whole[:: max(1, len(whole) // PLACES)]
    around = whole[cKDTree(whole).query(some, AROUND)[1]]
    way = around - closest_points(around.reshape(-1, 3), points, faces).points.reshape(around.shape)
    distance, lost = np.linalg.norm(way, axis=2), float(np.percentile(np.linalg.norm(way.mean(axis=1), axis=1), 95))
    said = f"{triangles} triangles are thinned to {len(faces)}; places of the scan lie {lost:.3f} mm off at 95 %"
    LOG.warning(
        "case %r: %s: %s, single points, with their noise, %.3f mm, and %.3f mm at most",
        *(case, file, said, np.percentile(distance, 95), distance.max()),
    )
    if not lost <= THINNING:
        raise InputError(case, file, said, f"export the face alone, with at most {MANY} triangles")
    return points, faces


def check_scan(
    points, faces, skin_points, skin_faces, plane: float, registration: Registration, *, case: str, file: object
) -> None:
    """Refuse (InputError) what fits the upper face but is no scan of it.

    points (p, 3), faces (f, 3): the scan in its own frame; skin_points, skin_faces: the skin before surgery, LPS mm;
    plane: height z (mm) above which they were registered; found: the registration. Refused are the skin before surgery
    itself, a mirror image, a face of another size, a surface without depth, one that shows hardly any of the upper
    face or no bridge of the nose, as the back of a head, and one that touches it here and there.
    """
    refuse = refusal(case, file)
    placed = registration.motion.apply(np.asarray(points, float))
    few = spread(placed, faces, SAMPLES)
    whole = float(np.percentile(closest_points(placed[few], skin_points, skin_faces).distance, 95))
    if not whole > THE_SAME:
        problem = f"95 % of it lies within {whole:.3f} mm of the skin before surgery: it is this skin itself"
        refuse(problem, "give the scan that was taken after surgery")
    upper = placed[few][placed[few][:, 2] >= plane]
    depth = float(np.linalg.svd(upper - upper.mean(axis=0), compute_uv=False)[2] / np.sqrt(len(upper)))
    if not depth >= DEPTH:
        problem = f"its upper face is flat: {depth:.1f} mm deep where a face has more than {DEPTH:g} mm"
        refuse(problem, "give a surface of the face, as a scanner makes it")
    normals = vertex_normals(skin_points, skin_faces)
    front = np.flatnonzero((skin_points[:, 2] >= plane) & (normals[:, 1] < FRONT))
    closest = closest_points(skin_points[front], placed, faces)
    covered = float(((closest.distance < SHOWN) & ~closest.border).mean()) if len(front) else 0.0
    if not covered >= COVERED:
        problem = f"it shows {100 * covered:.0f} % of the upper face (at least {100 * COVERED:.0f} % is asked)"
        refuse(problem, "give a scan with forehead and bridge of the nose")
    off = float(np.median(closest.distance[~closest.border]))
    if not off <= OFF:
        refuse(f"half of the upper face lies {off:.1f} mm or more off it", "give a scan of this face")
    below = skin_points[:, 2] - plane
    bridge = (normals[:, 1] < FRONT) & (below > -BELOW) & (below < ABOVE)
    bridge &= np.abs(skin_points[:, 0] - middle_of_face(skin_points, plane)) < BESIDE
    closest = closest_points(skin_points[bridge], placed, faces)
    shown = float(((closest.distance < NEAR) & ~closest.border).mean()) if bridge.any() else 0.0
    if not shown >= BRIDGE:
        refuse(
            f"it lies within {NEAR:g} mm of {100 * shown:.0f} % of the bridge of the nose and what is beside it "
            f"(at least {100 * BRIDGE:.0f} % is asked): it is no face, or not this one",
            "give a scan of this patient's face from in front, with forehead and nose",
        )
    residual, mirrored, scaled, scale = registered_again(points, faces, skin_points, skin_faces, plane, registration)
    if not (scaled >= SCALED_BETTER * residual or abs(scale - 1) <= SCALE):
        refuse(
            f"made {scale:.3f} times as large it fits the upper face better ({scaled:.2f} mm) than it does "
            f"({residual:.2f} mm)",
            "export the scan in its true size, and check the scanner's calibration",
        )
    if not mirrored > MIRROR_BETTER * residual:
        problem = f"its mirror image fits the upper face better ({mirrored:.2f} mm) than it does ({residual:.2f} mm)"
        refuse(problem, "export the scan without mirroring")
