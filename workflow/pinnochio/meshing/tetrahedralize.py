"""Tetrahedra of the soft tissue from a label map: a body-centred cubic lattice, fitted to the label boundaries.

The idea follows isosurface stuffing (Labelle and Shewchuk 2007): well-shaped lattice cells, their nodes moved onto
the boundaries as far as the shape of every cell allows.
"""

import logging
from dataclasses import dataclass
from itertools import product
from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from pinnochio.errors import InputError, refusal
from pinnochio.geometry.mesh_topology import EDGES, adjacency, compacted, side_nodes, single_sides
from pinnochio.meshing.fields import Fields, is_tissue, without_specks
from pinnochio.meshing.mesh import TetMesh, volumes
from pinnochio.meshing.smoothing import acceptable_move, neighbour_mean
from pinnochio.meshing.splitting import crowded_cells, cut_nodes, joined_pairs, pieces, simplex_points, split_nodes
from pinnochio.model.labels import MUSCLE, SUPERFICIAL

LOG = logging.getLogger(__name__)
NODE_TOLERANCE = 0.07  # the search stops here; the promise is 10 %
DIHEDRAL_MARGIN = 2.0  # degrees kept above the promised dihedral angle
NEAR_SLIT = 0.5  # of the lattice constant: so near, a lattice node goes to the middle of a thin void
FADE = 0.9  # of half the volume: over which a turn of the lattice fades towards a cut side
REACH = 1.5  # of the lattice constant: nothing asks how far beyond that a boundary is
THIN_SHARE = 0.6  # of the lattice constant: narrower voids are opened by splitting, wider ones are left out


@dataclass(frozen=True)
class Placing:
    """Where the lattice lies: shift (3,) mm; turn in degrees about the vertical axis; cut as of _cut_sides."""

    shift: np.ndarray
    turn: float
    cut: np.ndarray

    def turned(self, points, fields: Fields) -> np.ndarray:
        """Points (n, 3) mm turned about the middle of the volume, less and less towards its cut sides."""
        if not self.turn:
            return points
        middle, half = (fields.high + fields.low) / 2, (fields.high - fields.low) / 2
        place = (points - middle) / half
        share = np.ones(len(points))
        for axis, sides in enumerate(self.cut):
            for side, is_cut in zip((-1, 1), sides, strict=True):
                if is_cut:
                    share *= np.clip((1 - side * place[:, axis]) / FADE, 0, 1)
        angle = np.radians(self.turn) * share * share * (3 - 2 * share)
        x, y = (points - middle)[:, :2].T
        moved = [np.cos(angle) * x - np.sin(angle) * y, np.sin(angle) * x + np.cos(angle) * y]
        return np.column_stack([*moved, (points - middle)[:, 2]]) + middle


def tetrahedralize(
    labels,
    spacing,
    origin,
    target_nodes: int,
    *,
    shift=(0.0, 0.0, 0.0),
    turn: float = 0.0,
    minimum_dihedral: float = 12.0,
) -> TetMesh:
    """Conforming mesh of muscle and superficial tissue with about `target_nodes` nodes.

    labels (nx, ny, nz) internal codes [ix, iy, iz]; spacing, origin (3,) mm; shift (3,) mm moves the lattice inside the
    volume, for a second mesh that shares no node with the first, and turn (degrees) turns it about the vertical axis,
    less towards sides of the volume where tissue is cut; minimum_dihedral degrees (at most 30).
    Voids thinner than the lattice are opened: their two sides share no node. Faces on the border of the volume stay
    exactly flat. Pieces that do not hang on the largest one are dropped, and so are features thinner than about half
    a lattice cell. The same input gives the same bytes. Raises InputError for a map without tissue or a bad argument.
    """
    refuse = refusal("-", "labels")
    labels, spacing, origin = np.asarray(labels), np.asarray(spacing, float), np.asarray(origin, float)
    _check(labels, spacing, origin, target_nodes, minimum_dihedral)
    inside = is_tissue(labels)
    if not inside.any():
        refuse("holds no soft tissue", "label muscle or superficial tissue")
    constant = (2 * inside.sum() * np.prod(spacing) / target_nodes) ** (1 / 3)
    reach = np.array(labels.shape) * spacing / 2
    aside = abs(np.sin(np.radians(turn))) * np.array([reach[1], reach[0], 0])
    cut = _cut_sides(inside)
    labels, origin = _cropped(labels, inside, spacing, origin, margin=1.5 * constant + aside)
    fields = Fields(without_specks(labels), spacing, origin, thin=THIN_SHARE * constant, reach=REACH * constant)

    placing = Placing(np.asarray(shift, float), turn, cut)
    best, factor = None, 1.04  # factor: nodes of the finished mesh per node of the raw lattice
    for _ in range(4):
        lattice = _lattice_of(fields, placing, target_nodes / factor, constant)
        mesh = _mesh(fields, lattice, minimum_dihedral + DIHEDRAL_MARGIN)
        count = len(mesh.points)
        LOG.info("lattice of %d x %d x %d cells: %d nodes", *lattice.divisions, count)
        if best is None or abs(count - target_nodes) < abs(len(best.points) - target_nodes):
            best = mesh
        if abs(count - target_nodes) <= NODE_TOLERANCE * target_nodes:
            break
        factor = max(count, 1) / lattice.count
    if len(best.cells) == 0:
        refuse("no lattice cell fits into the tissue", "ask for more nodes")
    return best


def _check(labels, spacing, origin, target_nodes, minimum_dihedral) -> None:
    refuse = refusal("-", "labels")
    if labels.ndim != 3:
        refuse(f"has {labels.ndim} axes, not 3", "give one label volume")
    if spacing.shape != (3,) or origin.shape != (3,) or not np.isfinite([spacing, origin]).all():
        refuse("spacing and origin are not three finite numbers", "give them in mm")
    if (spacing <= 0).any():
        refuse(f"spacing {spacing} is not positive", "give it in mm")
    if target_nodes < 50:
        raise InputError("-", "mesh", f"{target_nodes} nodes cannot carry a face", "ask for 50 nodes at least")
    if not 0 <= minimum_dihedral <= 30:
        raise InputError("-", "mesh", f"minimum dihedral angle {minimum_dihedral}", "choose 0 to 30 degrees")


def _cut_sides(inside) -> np.ndarray:
    """Whether tissue touches the border of the volume, (2, 2) bool: low and high side along x and y."""
    return np.array([[inside.take(end, axis).any() for end in (0, -1)] for axis in (0, 1)])


def _cropped(labels, inside, spacing, origin, margin):
    """The part of the volume around the tissue, with a margin (3,) mm; air is added where the border has only air."""
    box, missing = [], []
    for axis in range(3):
        filled = np.flatnonzero(inside.any(axis=tuple({0, 1, 2} - {axis})))
        extra = int(np.ceil(margin[axis] / spacing[axis])) + 1
        low, high = filled[0] - extra, labels.shape[axis] - 1 - filled[-1] - extra
        missing.append([max(-low, 0) * (filled[0] > 0), max(-high, 0) * (filled[-1] < labels.shape[axis] - 1)])
        box.append(slice(max(low, 0), filled[-1] + extra + 1))
    start = origin + spacing * [s.start - before for s, (before, _) in zip(box, missing, strict=True)]
    return np.pad(labels[tuple(box)], missing), start


class _Lattice(NamedTuple):
    """Cells per axis; points (n, 3), cells (m, 4) and free (n, 3) of :func:`_lattice`; label (m,); its tissue nodes."""

    divisions: tuple[int, int, int]
    points: np.ndarray
    cells: np.ndarray
    free: np.ndarray
    label: np.ndarray
    count: int


def _lattice_of(fields, placing, wanted: float, constant: float) -> _Lattice:
    """The raw lattice that has about `wanted` tissue nodes."""
    best = None
    for _ in range(4):
        ideal = (fields.high - fields.low) / constant
        choices = product(*({max(1, int(np.floor(n))), int(np.ceil(n))} for n in ideal))
        divisions = min(sorted(choices), key=lambda n: abs(np.log(np.prod(n) / np.prod(ideal))))
        points, cells, free = _lattice(fields, divisions, placing)
        label = _classified(points, cells, fields)
        count = max(len(compacted(cells[label > 0])[0]), 1)
        if best is None or abs(count - wanted) < abs(best.count - wanted):
            best = _Lattice(divisions, points, cells, free, label, count)
        if abs(count - wanted) <= 0.02 * wanted:
            break
        constant *= (count / wanted) ** (1 / 3)
    return best


def _lattice(fields, divisions, placing: Placing) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Body-centred cubic tetrahedra near the tissue: points (n, 3), cells (m, 4), free (n, 3).

    The lattice fills the volume exactly; free tells in which directions a node may move without leaving a border
    plane. Shift and turn fade towards the borders, which keep their planes.
    """
    divisions = np.array(divisions)
    extent = fields.high - fields.low
    size = extent / divisions
    shift = (placing.shift + size / 2) % size - size / 2  # the lattice repeats

    def place(fraction):
        return placing.turned(fields.low + extent * fraction, fields) + shift * np.sin(np.pi * fraction)

    cell = np.stack(np.indices(divisions), axis=-1).reshape(-1, 3)
    near = fields.sample(fields.body, place((cell + 0.5) / divisions)) > -1.2 * size.max()
    near = near.reshape(divisions)
    corners = np.prod(divisions + 1)

    def corner_id(index):
        return np.ravel_multi_index(tuple(index.T), divisions + 1)

    def centre_id(index):
        return corners + np.ravel_multi_index(tuple(index.T), divisions)

    cells = []
    unit = np.eye(3, dtype=int)
    near_cells = np.argwhere(near)
    for axis in range(3):
        one, two = unit[(axis + 1) % 3], unit[(axis + 2) % 3]
        around = [np.zeros(3, int), one, one + two, two]
        # Four cells around the line between two neighbouring centres.
        pair = near_cells[near_cells[:, axis] + 1 < divisions[axis]]
        pair = pair[near[tuple((pair + unit[axis]).T)]]
        square = [corner_id(pair + unit[axis] + q) for q in around]
        ends = centre_id(pair), centre_id(pair + unit[axis])
        cells += [np.stack([*ends, square[i], square[(i + 1) % 4]], axis=1) for i in range(4)]
        # Half pyramids under the two border planes, the diagonal in turn one way and the other.
        for layer, offset in ((0, 0), (divisions[axis] - 1, 1)):
            base = near_cells[near_cells[:, axis] == layer]
            square = np.stack([corner_id(base + offset * unit[axis] + q) for q in around], axis=1)
            turned = base.sum(axis=1) % 2 == 1
            square[turned] = np.roll(square[turned], 1, axis=1)
            centre = centre_id(base)[:, None]
            cells += [np.hstack([centre, square[:, [0, 1, 2]]]), np.hstack([centre, square[:, [0, 2, 3]]])]
    used, cells = compacted(np.concatenate(cells))
    is_corner = used < corners
    index = np.empty((len(used), 3))
    index[is_corner] = np.stack(np.unravel_index(used[is_corner], divisions + 1), axis=1)
    index[~is_corner] = np.stack(np.unravel_index(used[~is_corner] - corners, divisions), axis=1) + 0.5
    points = place(index / divisions)
    inverted = volumes(points, cells) < 0
    cells[inverted] = cells[inverted][:, [0, 1, 3, 2]]
    points = np.where(index == 0, fields.low, np.where(index == divisions, fields.high, points))
    return points, cells, (index > 0) & (index < divisions)


def _classified(points, cells, fields) -> np.ndarray:
    """Label (m,) of every cell: 0 void or the tissue that fills most of it."""
    mesh = points, cells, simplex_points(4, 3)
    tissue = fields.filled(fields.body, *mesh, np.ones(len(cells), bool))
    return np.where(tissue, np.where(fields.filled(fields.muscle, *mesh, tissue), MUSCLE, SUPERFICIAL), 0)


def _mesh(fields, lattice: _Lattice, minimum) -> TetMesh:
    _, points, cells, free, label, _ = lattice
    size = float(((fields.high - fields.low) / lattice.divisions).min())
    # Fit the lattice, with the void cells that touch tissue, to the boundaries and to the middle of thin voids.
    for fraction in (0.5, 0.0):
        label = _without_pinches(points, cells, label, fields)
        tissue = np.zeros(len(points), bool)
        tissue[cells[label > 0]] = True
        points, cells, free, label = _compact(points, cells, free, label, tissue[cells].any(axis=1))
        target = _targets(points, cells, label, free, fields, size, fraction)
        middle, _, _ = _slit(points, free, np.arange(len(points)), fields, NEAR_SLIT * size)
        points = acceptable_move(points, np.where(np.isnan(middle), target, middle), cells, minimum)
        label = _classified(points, cells, fields)
    label = _without_pinches(points, cells, label, fields)
    points, cells, free, label = _compact(points, cells, free, label, label > 0)
    # Draw the cuts onto the middle of the thin voids, then open them.
    for last in (False, False, True):
        pairs = joined_pairs(points, cells, fields)
        middle, normal, half = _slit(points, free, cut_nodes(cells, *pairs), fields, 0.7 * size)
        if not last:
            points = acceptable_move(points, np.where(np.isnan(middle), points, middle), cells, minimum)
    keep, split, old = _opened(points, cells, pairs)
    LOG.info("dropped %d of %d cells that hang on nothing or pinch an edge", (~keep).sum(), len(keep))
    points, middle, normal, half, free = (array[old] for array in (points, middle, normal, half, free))
    cells, label = split, label[keep]
    lips = _lips(points, cells, middle, normal, half) * free + points * ~free
    for fraction in (0.5, 0.3, 0.0):
        target = _targets(points, cells, label, free, fields, size, fraction)
        target = np.where(np.isnan(lips), target, lips)
        points = acceptable_move(points, target, cells, minimum)
    return TetMesh(points, cells.astype(np.int32), label.astype(np.int8))


def _without_pinches(points, cells, label, fields) -> np.ndarray:
    """Labels with void cells filled so that no tissue node touches void on two sides (skin and bone, say).

    Such a node would be a hinge in a sheet one cell thick. The side with fewer void cells is filled.
    """
    label = label.copy()
    for _ in range(4):
        tissue_node = np.zeros(len(points), bool)
        tissue_node[cells[label > 0]] = True
        void = np.flatnonzero(label == 0)
        void = void[tissue_node[cells[void]].any(axis=1)]
        split, old = split_nodes(cells[void], *adjacency(cells[void]))
        size = np.bincount(split.ravel())
        # Groups in the order of their node, the largest first: all but the first are filled.
        order = np.lexsort((-size, old))
        extra = np.zeros(len(old), bool)
        extra[order[1:]] = old[order[1:]] == old[order[:-1]]
        extra &= tissue_node[old]
        fill = void[extra[split].any(axis=1)]
        if len(fill) == 0:
            break
        muscle = fields.sample(fields.muscle, points[cells[fill]].mean(axis=1)) > 0
        label[fill] = np.where(muscle, MUSCLE, SUPERFICIAL)
    return label


def _compact(points, cells, free, label, keep):
    """Only the kept cells and their nodes."""
    used, cells = compacted(cells[keep])
    return points[used], cells, free[used], label[keep]


def _targets(points, cells, label, free, fields, size, smoothing: float) -> np.ndarray:
    """Where nodes should go: on boundaries, after some smoothing along them; others between their neighbours."""
    a, b = adjacency(cells)
    between = a[label[a // 4] != label[b // 4]]
    # Faces within a border plane of the volume are cut planes, not boundaries of tissue.
    alone = side_nodes(cells, single_sides(cells, a, b))
    alone = alone[free[alone].any(axis=1).all(axis=1)]
    surface = np.concatenate([side_nodes(cells, between), alone])
    kinds = np.zeros((len(points), 3), bool)
    for code in (0, SUPERFICIAL, MUSCLE):
        kinds[cells[label == code], code] = True
    kinds[alone, 0] = True
    tissue_nodes = kinds[:, 1] | kinds[:, 2]
    outer, inner = kinds[:, 0] & tissue_nodes, kinds[:, 1] & kinds[:, 2]

    rim = surface[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2)
    mean = neighbour_mean(points, cells[:, EDGES].reshape(-1, 2))
    along = neighbour_mean(points, rim)
    bound = outer | inner
    mean[bound] = along[bound]
    mean[outer & inner] = points[outer & inner]
    start = points + smoothing * (mean - points) * free
    target = start.copy()
    for _ in range(3):
        target[bound] = _newton(target[bound], outer[bound], inner[bound], free[bound], fields)
    step = target - start
    length = np.linalg.norm(step, axis=1, keepdims=True)
    return start + step * np.minimum(1, 0.7 * size / np.maximum(length, 1e-12))


def _newton(points, outer, inner, free, fields) -> np.ndarray:
    """One least-norm Newton step to the zero of the tissue field (outer), of the muscle field (inner), or of both."""
    value = np.stack([fields.sample(field, points) for field in (fields.tissue, fields.muscle)], axis=1)
    slope = np.stack([fields.gradient(field, points) for field in (fields.tissue, fields.muscle)], axis=1)
    active = np.stack([outer, inner], axis=1)
    slope *= free[:, None, :] * active[:, :, None]
    value = value * active
    gram = np.einsum("nax,nbx->nab", slope, slope) + 0.02 * np.eye(2)
    return points - np.einsum("nax,na->nx", slope, np.linalg.solve(gram, value[..., None])[..., 0])


def _slit(points, free, nodes, fields, limit: float):
    """For some nodes, if a thin void is within the limit: the place (n, 3) on its middle, its normal (n, 3) and
    its half width (n,). NaN for all other nodes."""
    middle, normal, half = (np.full(shape, np.nan) for shape in (points.shape, points.shape, len(points)))
    centres, width = fields.thin_void
    if len(nodes) == 0 or len(centres) < 8:
        return middle, normal, half
    tree = cKDTree(centres)
    distance, nearest = tree.query(points[nodes], distance_upper_bound=limit)
    cut, nearest = nodes[distance < limit], nearest[distance < limit]
    _, group = tree.query(centres[nearest], k=min(25, len(centres)))
    cloud = centres[group]
    weight = width[group][..., None]
    mean = (cloud * weight).sum(axis=1) / weight.sum(axis=1)
    spread = np.einsum("nki,nkj->nij", (cloud - mean[:, None]) * weight, cloud - mean[:, None])
    across = np.linalg.eigh(spread)[1][:, :, 0]
    step = np.einsum("ni,ni->n", mean - points[cut], across)
    middle[cut] = points[cut] + step[:, None] * across * free[cut]
    normal[cut], half[cut] = across, width[group].max(axis=1)
    return middle, normal, half


def _opened(points, cells, pairs):
    """Cells to keep (m,), the kept cells with nodes split where they hang apart, and the old index of each node."""
    keep = np.ones(len(cells), bool)
    first, second = pairs
    while True:
        renumber = np.cumsum(keep) - 1
        alive = keep[first // 4] & keep[second // 4]
        a, b = (4 * renumber[side[alive] // 4] + side[alive] % 4 for side in pairs)
        kept = np.flatnonzero(keep)
        loose = pieces(len(kept), a, b) > 0
        if not loose.any():
            split, old = split_nodes(cells[kept], a, b)
            loose = np.zeros(len(kept), bool)
            loose[crowded_cells(points[old], split)] = True
            if not loose.any():
                return keep, split, old
        keep[kept[loose]] = False


def _lips(points, cells, middle, normal, half) -> np.ndarray:
    """Where the copies of a slit node belong: half the width off the middle, on the side of their own cells."""
    centre = points[cells].mean(axis=1)
    count = np.bincount(cells.ravel(), minlength=len(points))
    centroid = (
        np.stack([np.bincount(cells.ravel(), np.repeat(c, 4), len(points)) for c in centre.T], axis=1) / count[:, None]
    )
    side = np.sign(np.einsum("ni,ni->n", centroid - points, normal))
    return middle + (side * half)[:, None] * normal
