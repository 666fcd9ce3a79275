"""Brings the post-operative skin into the patient's frame by the part of the face that surgery leaves alone."""

from dataclasses import dataclass
from itertools import permutations, product

import numpy as np
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from pinnochio.errors import InputError, refusal
from pinnochio.geometry.closest_points import closest_points
from pinnochio.geometry.triangles import face_normals, vertex_normals
from pinnochio.importing.stable_skin import Certainty, likeliest, unstable
from pinnochio.model.bones import nasion_height
from pinnochio.model.surfaces import BoneSurface
from pinnochio.plans.plan import RigidMotion

SAMPLES, COARSE_SAMPLES = 4000, 500
FEWEST = 50  # points above the plane that a registration needs
COARSE_KEPT = 0.7  # share of the pairs that a coarse step keeps, nearest first
COARSE_FIRST, COARSE_TRIED, COARSE_LAST = 48, 16, 10  # starts compared by all points, on the upper face, and last
COARSE_EACH, COARSE_VERTICES = 3, 8000  # one point in so many begins; vertices of the surface that are searched
COARSE_CUT, COARSE_REACH = 5.0, 15.0  # mm
COARSE_LEAST = 0.15  # share of the scan that must lie on the upper face
SETTLING = 1800  # points that settle the motion
SETTLE_STEPS, SETTLED = 20, 0.005  # at most, and mm of one that ends them
FACE = 90.0  # mm below the plane where a face ends at the latest, where no bone says it [I]


@dataclass(frozen=True)
class Registration:
    """Rigid motion of the scan onto the skin and its residual, mm, on the part that surgery leaves alone.

    median, p95: distances of the scan's points there from the skin; count: how many points. face_p95, face_bias: how
    far the scan may be off below, on the face that is judged (:meth:`Certainty.on`).
    """

    motion: RigidMotion
    median: float
    p95: float
    count: int
    face_p95: float = np.nan
    face_bias: float = np.nan


def upper_face_plane(bone: BoneSurface, segments: tuple[str, ...], nasion_above_lefort: float) -> float:
    """Height z (mm) of the nasion plane, as :func:`pinnochio.model.bones.nasion_height`; InputError without bone."""
    height = nasion_height(bone.points, bone.segment, segments, nasion_above_lefort)
    if not np.isfinite(height):
        raise InputError("-", "bone surface", "no segment has a surface", "label the bone segments")
    return height


def register(
    points,
    faces,
    skin_points,
    skin_faces,
    plane: float,
    *,
    case: str,
    file: object,
    limit: float,
    bone: BoneSurface | None = None,
) -> Registration:
    """Robust point-to-plane registration of a scan on the skin above z = plane (mm).

    points (p, 3), faces (f, 3): the scan, in any frame; skin_points, skin_faces: the skin, LPS. Coarse starts
    (identity, the axes of both surfaces) are compared on the whole face; the best is refined on the upper face alone,
    and, with a bone, settled by how stable its skin is (:mod:`pinnochio.importing.stable_skin`): by how thick it lies
    on the bone, and how far it is from the forehead.
    Raises InputError if the median residual exceeds `limit` mm.
    """
    refuse = refusal(case, file)
    points, skin_points = np.asarray(points, float), np.asarray(skin_points, float)
    if (skin_points[:, 2] >= plane).sum() < FEWEST:
        problem = f"hardly any skin of the segmentation lies above the nasion plane (z = {plane:.0f} mm)"
        refuse(problem, "segment the head up to the forehead")
    all_normals = vertex_normals(points, faces)
    few = spread(points, faces, COARSE_SAMPLES)
    if len(few) < FEWEST:
        refuse("it has hardly any surface", "give a surface of the face, as a scanner makes it")
    front = skin_points[skin_points[:, 1] <= np.median(skin_points[:, 1])]  # a scan shows the face, not the nape
    rotation, shift = coarse(points[few], all_normals[few], skin_points, skin_faces, plane, front)
    # From here on only what lies above the plane, and a margin that the scan may still turn through.
    near = points @ rotation.T + shift
    upper = faces[(near[faces, 2] >= plane - 10).all(axis=1)]
    chosen = spread(points, upper, SAMPLES)
    moving, normals = points[chosen], all_normals[chosen]
    near_faces = skin_faces[(skin_points[skin_faces, 2] >= plane - 20).any(axis=1)]
    rotation, shift = _fine(moving, normals, rotation, shift, skin_points, near_faces, plane)
    few = spread(points, upper, SETTLING)
    motion = RigidMotion(rotation, shift)
    settled, certainty = _settled(points[few], all_normals[few], motion, skin_points, near_faces, plane, bone)
    if bone is not None:
        motion = settled
    surfaces = (points, faces), (skin_points, near_faces)
    return measured(motion, certainty, *surfaces, plane, bone, case=case, file=file, limit=limit)


def measured(
    motion: RigidMotion,
    certainty: Certainty,
    scan: tuple[np.ndarray, np.ndarray],
    skin: tuple[np.ndarray, np.ndarray],
    plane: float,
    bone: BoneSurface | None,
    *,
    case: str,
    file: object,
    limit: float,
) -> Registration:
    """The registration of a scan (points, faces) on the skin (points, faces) that a motion is, with what it leaves.

    InputError if the median residual above z = plane (mm) exceeds `limit` mm.
    """
    points, faces = motion.apply(np.asarray(scan[0], float)), scan[1]
    chosen = spread(points, faces[(points[faces, 2] >= plane).all(axis=1)], SAMPLES)
    closest = closest_points(points[chosen], *skin)
    distance = closest.distance[~closest.border]
    median = float(np.median(distance)) if len(distance) >= FEWEST else np.inf  # a few points fit anywhere
    if not median <= limit:
        refusal(case, file)(
            f"registered on the upper face it leaves a median residual of {median:.2f} mm (limit {limit:g} mm)",
            "check that the scan is of this patient, shows the forehead from outside and is not mirrored",
        )
    chin = plane - FACE if bone is None else bone.points[bone.segment >= 0, 2].min(initial=plane)
    height = points[faces, 2]
    face = spread(points, faces[((height < plane) & (height > chin)).all(axis=1)], SAMPLES)
    uncertain = certainty.on(points[face], vertex_normals(points, faces)[face])
    p95 = float(np.percentile(distance, 95)) if len(distance) else np.nan
    return Registration(motion, median, p95, len(distance), *uncertain)


def registered_again(
    points, faces, skin_points, skin_faces, plane: float, registration: Registration
) -> tuple[float, float, float, float]:
    """Mean residual (mm, robust) of a registered scan, of its mirror image registered in its place, and of the scan
    registered in its place with a scale of its own; and this scale.

    The mirror is the middle plane of the skin's upper face, from where a few steps lead to the best fit.
    """
    skin_points, middle = np.asarray(skin_points, float), middle_of_face(skin_points, plane)
    placed = registration.motion.apply(np.asarray(points, float))
    chosen = spread(placed, faces[(placed[faces, 2] >= plane - 10).all(axis=1)], SAMPLES)
    near = skin_faces[(skin_points[skin_faces, 2] >= plane - 20).any(axis=1)]
    residuals = []
    for mirror, scaled in ((1.0, False), (-1.0, False), (1.0, True)):
        image = (placed[chosen] - [middle, 0, 0]) * [mirror, 1, 1] + [middle, 0, 0]
        normals = vertex_normals(placed, faces)[chosen] * [mirror, 1, 1]
        rotation, shift = _fine(image, normals, np.eye(3), np.zeros(3), skin_points, near, plane, 80, scaled)
        image = image @ rotation.T + shift
        closest = closest_points(image[image[:, 2] >= plane], skin_points, near)
        distance = closest.distance[~closest.border]
        residuals.append(float(np.minimum(distance, COARSE_CUT).mean()) if len(distance) >= FEWEST else np.inf)
    return *residuals, float(np.cbrt(np.linalg.det(rotation)))


def middle_of_face(skin_points, plane: float) -> float:
    """x (mm) halfway across the skin above z = plane (mm)."""
    upper = skin_points[skin_points[:, 2] >= plane, 0]
    return float(upper.min() + upper.max()) / 2


def spread(points, faces, count: int) -> np.ndarray:
    """Vertices chosen evenly over the area, in the order of z, so that dense parts weigh no more than sparse."""
    areas = np.bincount(faces.ravel(), np.repeat(face_normals(points, faces)[1], 3), minlength=len(points))
    if not areas.sum() > 0:
        return np.zeros(0, int)
    order = np.argsort(points[:, 2], kind="stable")
    share = np.cumsum(areas[order]) / areas.sum()
    picked = np.searchsorted(share, (np.arange(count) + 0.5) / count).clip(max=len(points) - 1)
    return order[np.unique(picked)]


def coarse(moving, normals, skin_points, skin_faces, plane: float, front) -> tuple[np.ndarray, np.ndarray]:
    """Rotation (3, 3) and shift (3,) that bring the points `moving` (k, 3) with their normals onto a surface.

    The best of many starts on the vertices of the surface, a skin or a skull: a few steps on all of it each, with few
    points, then the most promising are followed on what lies above z = plane (mm) alone. front (n, 3): the part that
    `moving` shows.
    """
    skin_normals = vertex_normals(skin_points, skin_faces)

    def view(each, at):
        return moving[::each], normals[::each], cKDTree(skin_points[at]), skin_points[at], skin_normals[at]

    def pairs(turns, shifts, low, view):
        """Of every start: places, nearest vertices and their normals, distances, cosines, what lies above z = low."""
        points, ways, tree, vertices, vertex_ways = view
        placed = points @ turns.mT + shifts[:, None]
        distance, near = tree.query(placed)
        facing = np.einsum("skx,skx->sk", ways @ turns.mT, vertex_ways[near])
        return placed, vertices[near], vertex_ways[near], distance, facing, placed[..., 2] >= low

    def best(turns, shifts, low, view, count):
        """Which starts have the least mean distance along the normals above z = low, cut off where nothing fits: an
        outlier costs the same in any pose, and a pose that has hardly any point there is no fit."""
        placed, near, ways, distance, facing, counted = pairs(turns, shifts, low, view)
        off = np.minimum(np.abs(np.einsum("skx,skx->sk", placed - near, ways)), COARSE_CUT)
        off = np.where((facing > 0.5) & (distance < COARSE_REACH), off, COARSE_CUT)
        share = counted.mean(axis=1)
        cost = np.where(share > COARSE_LEAST, (off * counted).mean(axis=1) / np.maximum(share, 1e-9), COARSE_CUT)
        return np.argsort(cost, kind="stable")[:count]  # ties stay in order

    def improved(turns, shifts, low, view, steps):
        for _ in range(steps):
            placed, near, ways, distance, facing, used = pairs(turns, shifts, low, view)
            used &= facing > 0
            count = used.sum(axis=1, keepdims=True)
            ordered = np.sort(np.where(used, distance, np.inf), axis=1)
            last = (COARSE_KEPT * np.maximum(count - 1, 0)).astype(int)
            used &= (distance <= np.take_along_axis(ordered, last, axis=1)) & (count >= 20)
            turn, move = step(placed, near, ways, used)
            turns, shifts = turn @ turns, np.einsum("sxy,sy->sx", turn, shifts) + move
        return turns, shifts

    anywhere, upper, sparse = -np.inf, plane - 10, spread(skin_points, skin_faces, COARSE_VERTICES)
    few, every, whole = view(COARSE_EACH, sparse), view(1, sparse), view(1, slice(None))
    starts = [np.array(parts) for parts in zip(*_starts(moving, front), strict=True)]
    moved = improved(*starts, anywhere, few, 5)
    kept = best(*moved, anywhere, few, COARSE_FIRST)
    kept = kept[best(*(part[kept] for part in moved), anywhere, every, COARSE_TRIED)]
    kept = kept[best(*improved(*(part[kept] for part in moved), upper, every, 10), upper, every, COARSE_LAST)]
    # The last go all the way from their starts by all vertices: where that ends does not depend on the few.
    moved = improved(*improved(*(part[kept] for part in starts), anywhere, whole, 5), upper, whole, 25)
    (first,) = best(*moved, upper, whole, 1)
    return moved[0][first], moved[1][first]


def _starts(moving, front):
    """Identity; then turns (24 of the axes, 4 of both principal frames), each on the points `front` or beside them."""
    yield np.eye(3), np.zeros(3)
    turns = [np.eye(3)[list(order)] * np.array(signs)[:, None]
             for order in permutations(range(3)) for signs in product((1, -1), repeat=3)]  # fmt: skip
    turns = [turn for turn in turns if np.linalg.det(turn) > 0]
    axes = [np.linalg.svd(cloud - cloud.mean(axis=0), full_matrices=False)[2] for cloud in (moving, front)]
    axes = [frame * np.sign(np.linalg.det(frame)) for frame in axes]
    flips = [turn for turn in turns if np.count_nonzero(np.diag(turn)) == 3]
    middle = moving.mean(axis=0), front.mean(axis=0)
    for rotation in turns + [axes[1].T @ flip @ axes[0] for flip in flips]:
        for beside in ((0, 0, 0), (35, 0, 0), (-35, 0, 0), (0, 0, 35), (0, 0, -35)):  # half a face, a neck or hair
            yield rotation, middle[1] + beside - rotation @ middle[0]


def _fine(moving, normals, rotation, shift, skin_points, skin_faces, plane, steps: int = 40, scaled: bool = False):
    """Point-to-plane steps on exact closest points above the plane, until a step moves less than 1e-3 mm.

    scaled: the scan's size is found as well; it is a factor of the rotation.
    """
    skin_normals = face_normals(skin_points, skin_faces)[0]
    for _ in range(steps):
        placed = moving @ rotation.T + shift
        upper = np.flatnonzero(placed[:, 2] >= plane)
        if len(upper) < 20:
            break
        closest = closest_points(placed[upper], skin_points, skin_faces)
        facing = np.einsum("ij,ij->i", normals[upper] @ rotation.T, skin_normals[closest.face]) > 0.5
        fit = facing & ~closest.border
        if fit.sum() < 20:
            break
        # Tukey's weight: pairs beyond 4.7 robust deviations (hair, swelling, artefacts) count nothing, and noise
        # alone costs 5% of the precision; a hard trim would cost far more.
        spread = 4.685 * 1.4826 * max(np.median(closest.distance[fit]), 1e-3)
        weights = np.clip(1 - (closest.distance[fit] / spread) ** 2, 0, None) ** 2
        turn, move = step(placed[upper[fit]], closest.points[fit], skin_normals[closest.face[fit]], weights, scaled)
        change = np.abs(placed[upper] @ (turn - np.eye(3)).T + move).max()
        rotation, shift = turn @ rotation, turn @ shift + move
        if change < 1e-3:
            break
    return rotation, shift


def _settled(
    points, normals, motion: RigidMotion, skin_points, skin_faces, plane: float, bone: BoneSurface | None
) -> tuple[RigidMotion, Certainty]:
    """The motion of points (k, 3) with their normals, started near it, that stable skin makes most likely."""
    skin_normals = vertex_normals(skin_points, skin_faces)
    certainty = Certainty.none()
    for _ in range(SETTLE_STEPS):
        placed = motion.apply(points)
        closest = closest_points(placed, skin_points, skin_faces)
        towards = np.einsum("kc,kcx->kx", closest.weights, skin_normals[skin_faces[closest.face]])
        towards /= np.linalg.norm(towards, axis=1, keepdims=True)
        fit = (np.einsum("ij,ij->i", normals @ motion.rotation.T, towards) > 0.5) & ~closest.border
        fit &= placed[:, 2] >= plane
        if fit.sum() < FEWEST:
            break
        off = np.einsum("ij,ij->i", closest.points - placed, towards)[fit]
        moves = unstable(closest.points[fit], plane, bone)
        # At the points of the skin: places with the noise that their offsets have would bias the motion.
        change, certainty, _ = likeliest(closest.points[fit], off, towards[fit], moves)
        turn = RigidMotion(Rotation.from_rotvec(change[:3]).as_matrix(), change[3:], certainty.centre)
        way = np.abs(turn.displacement(placed)).max()
        motion = RigidMotion(turn.rotation @ motion.rotation, turn.apply(motion.apply(np.zeros((1, 3))))[0])
        if way < SETTLED:
            break
    return motion, certainty


def step(placed, targets, normals, weights=1.0, scaled: bool = False) -> tuple[np.ndarray, np.ndarray]:
    """Rotation and shift of the linearised, weighted least-squares step along the normals, of any number of starts
    (..., k, 3) with weights (..., k) at once; scaled: with a scale, which is a factor of the rotation."""
    weights = np.broadcast_to(weights, placed.shape[:-1])[..., None]
    centre = (weights * placed).sum(axis=-2, keepdims=True) / np.maximum(weights.sum(axis=-2, keepdims=True), 1e-9)
    away = placed - centre
    columns = [np.cross(away, normals), normals]
    if scaled:
        columns.append((away * normals).sum(axis=-1, keepdims=True))
    matrix = np.concatenate(columns, axis=-1)
    right = ((targets - placed) * normals).sum(axis=-1, keepdims=True)
    weighted = (matrix * weights).mT
    square = weighted @ matrix
    # A little damping: a sphere or a plane leaves turns undetermined.
    size = np.maximum(np.einsum("...ii->...i", square).max(axis=-1), 1e-9)
    damped = square + 1e-8 * size[..., None, None] * np.eye(matrix.shape[-1])
    solution = np.linalg.solve(damped, weighted @ right)[..., 0]
    turn = Rotation.from_rotvec(solution[..., :3]).as_matrix()
    if scaled:
        turn = turn * (1 + solution[..., 6, None, None])
    return turn, solution[..., 3:6] + centre[..., 0, :] - np.einsum("...xy,...y->...x", turn, centre[..., 0, :])
